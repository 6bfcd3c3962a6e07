"""STRING messages, against pyigtl."""

import pyigtl
import pytest

from app.igtl import read_string
from app.igtl.framing import HEADER_BYTES, IgtlContentError, IgtlError, pack_message, read_header


def parts(packet: bytes) -> tuple[object, bytes]:
    return read_header(packet[:HEADER_BYTES]), packet[HEADER_BYTES:]


@pytest.mark.parametrize("text", ["on", "", "coagulation runs"])
def test_text_of_a_peer_is_read(text):
    packet = pyigtl.StringMessage(text, device_name="Cautery").pack()
    assert read_string(*parts(packet)) == ("Cautery", text)


@pytest.mark.parametrize("content", [b"", b"\0\3", b"\0\3\0\5on", b"\0\7\0\2on", b"\0\3\0\1\xff"])
def test_other_content_is_refused(content):
    with pytest.raises(IgtlContentError, match="STRING"):
        read_string(*parts(pack_message("STRING", "Cautery", 0, content)))


def test_wrong_checksum_is_refused():
    packet = pyigtl.StringMessage("on", device_name="Cautery").pack()
    with pytest.raises(IgtlError, match="checksum"):
        read_string(*parts(packet[:-1] + b"x"))
