from pathlib import Path

import numpy as np
import pytest

from app.files import read_plus_config
from app.geometry import InputError
from tests.cli.real_case import plus_transform

FILE = "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml"


def configuration(folder: Path, inner: str, before: str = "") -> Path:
    path = folder / "plus.xml"
    path.write_text(f"{before}<PlusConfiguration>{inner}</PlusConfiguration>")
    return path


def coordinates(*transforms: str) -> str:
    return f"<CoordinateDefinitions>{''.join(transforms)}</CoordinateDefinitions>"


def landmarks(*entries: str) -> str:
    geometry = f"<Geometry><Landmarks>{''.join(entries)}</Landmarks></Geometry>"
    return f"<PhantomDefinition>{geometry}</PhantomDefinition>"


def test_recorded_configuration_is_read(shared_data):
    path = shared_data / "plus" / FILE
    found = read_plus_config(path)
    tip = found.transform("stylus", "stylus_tip")
    np.testing.assert_allclose(tip.matrix, plus_transform(path, "StylusTip"), atol=1e-4)
    assert list(found.landmarks_mm) == [f"#{number}" for number in range(1, 9)]
    np.testing.assert_array_equal(found.landmarks_mm["#4"], [104.3, -5.0, 0.0])
    with pytest.raises(InputError, match="no ProbeTipToProbe; it has StylusTipToStylus"):
        found.transform("probe", "probe_tip")


def test_configuration_in_the_layout_of_plus_is_read(tmp_path):
    """Among devices, with attributes of their own, and matrices over several lines."""
    path = tmp_path / "PlusDeviceSet_Server.xml"
    path.write_text(
        """<?xml version="1.0"?>
<PlusConfiguration version="2.3">
  <DataCollection StartupDelaySec="1.0">
    <DeviceSet Name="PlusServer: a tracker" Description="Simulated" />
    <Device Id="TrackerDevice" Type="FakeTracker" AcquisitionRate="20" />
  </DataCollection>
  <CoordinateDefinitions>
    <Transform From="Image" To="Probe" Matrix="0.2 0 0 1  0 0.2 0 2  0 0 0.2 3  0 0 0 1"
      Error="0.1" Date="092310_110233" />
    <Transform From="StylusTip" To="Stylus"
      Matrix="
        0 -1 0 210.5
        1  0 0 -0.25
        0  0 1 1e-005
        0  0 0 1" />
  </CoordinateDefinitions>
  <PhantomDefinition>
    <Description Name="fCAL" Type="Multi-N" Version="2.0" />
    <Geometry>
      <Pattern Type="NWire"><Wire Name="1" EndPointFront="0 0 0" EndPointBack="0 40 0" /></Pattern>
      <Landmarks>
        <Landmark Name="#1" Position="-10.5  0.0  35" />
        <Landmark Name="#2" Position="104.3 -5 0" />
      </Landmarks>
    </Geometry>
  </PhantomDefinition>
</PlusConfiguration>
"""
    )
    found = read_plus_config(path)
    tip = found.transform("stylus", "stylus_tip")
    np.testing.assert_allclose(tip.matrix, plus_transform(path, "StylusTip"), atol=1e-12)
    np.testing.assert_allclose(tip.translation_mm, [210.5, -0.25, 1e-5])
    assert list(found.landmarks_mm) == ["#1", "#2"]
    np.testing.assert_array_equal(found.landmarks_mm["#2"], [104.3, -5.0, 0.0])
    with pytest.raises(InputError, match="no ProbeTipToProbe; it has ImageToProbe, StylusTip"):
        found.transform("probe", "probe_tip")


def test_scaled_transform_does_not_affect_the_others(tmp_path):
    scaled = "<Transform From='Image' To='Probe' Matrix='.1 0 0 0 0 .1 0 0 0 0 .1 0 0 0 0 1'/>"
    rigid = "<Transform From='StylusTip' To='Stylus' Matrix='1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1'/>"
    found = read_plus_config(configuration(tmp_path, coordinates(scaled, rigid)))
    np.testing.assert_array_equal(
        found.transform("stylus", "stylus_tip").translation_mm, [5.0, 6.0, 7.0]
    )
    with pytest.raises(InputError, match=r"matrix of ImageToProbe.*not orthonormal"):
        found.transform("probe", "image")


def test_document_type_is_refused(tmp_path):
    bomb = (
        "<!DOCTYPE PlusConfiguration [<!ENTITY a 'xxxxxxxxxx'><!ENTITY b '&a;&a;&a;'>"
        f"<!ENTITY file SYSTEM '{tmp_path}/secret'>]>"
    )
    path = configuration(tmp_path, landmarks("<Landmark Name='&b;' Position='0 0 0'/>"), bomb)
    with pytest.raises(InputError, match="document type"):
        read_plus_config(path)


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        (landmarks("<Landmark Name='A' Position='1 2'/>"), "'A' has 2 numbers; expected 3"),
        (landmarks("<Landmark Name='A' Position='1 2 nan'/>"), "expected 3 finite numbers"),
        (landmarks("<Landmark Name='A' Position='1 2 z'/>"), "'A': 'z' is not a number"),
        (landmarks("<Landmark Position='1 2 3'/>"), "landmark 0 has no name"),
        (landmarks(*["<Landmark Name='A' Position='1 2 3'/>"] * 2), "'A' occurs twice"),
        (landmarks("<Landmark Name='A' Position='1_0 2 3'/>"), "'A': '1_0' is not a number"),
        (coordinates(*["<Transform From='A' To='B' Matrix=''/>"] * 2), "AToB occurs twice"),
        (coordinates("<Transform From='A' Matrix=''/>"), "From='A' To=''"),
        ("<open>", "not well-formed: "),
    ],
)
def test_malformed_entry_is_named(tmp_path, inner, message):
    with pytest.raises(InputError, match=message):
        read_plus_config(configuration(tmp_path, inner))


def test_other_xml_and_missing_file_are_refused(tmp_path):
    other = tmp_path / "other.xml"
    other.write_text("<robot/>")
    with pytest.raises(InputError, match="is a 'robot'; expected a PlusConfiguration"):
        read_plus_config(other)
    with pytest.raises(InputError, match="No such file"):
        read_plus_config(tmp_path / "none.xml")
