"""Archives that attackers make."""

import io
import zipfile
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from fitting_core.files.archives import open_members

DIRECTORY = b"PK\x01\x02"


def packed(content: bytes, compression: int) -> bytearray:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr("a.npz", content)
    return bytearray(buffer.getvalue())


def _small(archive: bytearray) -> None:
    place = archive.rindex(DIRECTORY)
    archive[place + 24 : place + 28] = (10).to_bytes(4, "little")


def _encrypted(archive: bytearray) -> None:
    archive[archive.rindex(DIRECTORY) + 8] |= 1


def _damaged(archive: bytearray) -> None:
    archive[200] ^= 255


@pytest.mark.parametrize(
    ("change", "compression", "message"),
    [
        (_small, zipfile.ZIP_DEFLATED, "holds more than the 10 bytes|is damaged or was cut off"),
        (_encrypted, zipfile.ZIP_STORED, "cannot be unpacked"),
        (_damaged, zipfile.ZIP_STORED, "is damaged or was cut off"),
    ],
)
def test_member_that_lies_is_refused(tmp_path: Path, change, compression: int, message: str):
    archive = packed(bytes(8 << 20), compression)
    change(archive)
    (tmp_path / "a.zip").write_bytes(archive)
    with pytest.raises(InputError, match=message), open_members(tmp_path / "a.zip") as (member,):
        member.copy_to(tmp_path / "copy")
    assert not (tmp_path / "copy").exists() or (tmp_path / "copy").stat().st_size <= 8 << 20
