"""A small case: the rod approaches the ball, enters and leaves it, and is lost for some frames."""

from pathlib import Path

from tests.cli.small_case import write_small_case

BREACH_FRAME = 20
LOST = range(30, 34)


def write_viewed_case(folder: Path) -> Path:
    """Write the small case with the rod invalid in the frames `LOST`."""
    case = write_small_case(folder)
    recording = case / "tracking.igs.mha"
    text = recording.read_text()
    for frame in LOST:
        status = f"Seq_Frame{frame:04}_RodToTrackerTransformStatus = "
        assert f"{status}OK" in text
        text = text.replace(f"{status}OK", f"{status}INVALID")
    recording.write_text(text)
    return case
