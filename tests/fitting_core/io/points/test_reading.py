"""Files of points that programs write and that look unusual, and what is left where writing fails."""

import struct
from pathlib import Path

import c3d
import numpy as np
import pytest

from fitting_core.io.points.c3d_file import read_c3d, write_c3d
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.io.points.trc import read_trc, write_trc

NAMES = ("Anna:LASI", "Anna:RASI")
PLACES = np.random.default_rng(0).normal(0, 0.3, (40, 2, 3))
POINTS = NamedPoints(names=NAMES, places=PLACES, frame_rate=120.0)


@pytest.fixture
def trc(tmp_path: Path) -> Path:
    write_trc(tmp_path / "walk.trc", POINTS)
    return tmp_path / "walk.trc"


@pytest.mark.parametrize(
    ("old", "new", "encoding"),
    [
        ("walk.trc", "C:\\Users\\José\\walk.trc", "latin-1"),
        ("PathFileType", "\ufeffPathFileType", "utf-8"),
        ("\n", "\r", "utf-8"),
        ("\n", "\r\n", "utf-8"),
        ("\n", "\t\n", "utf-8"),
        ("\tmm\t", "\tMM \t", "utf-8"),
    ],
    ids=["a folder in Latin-1", "byte order mark", "old Mac", "Windows", "a tab behind each line", "capitals"],
)
def test_unusual_trc_files_are_read(trc: Path, old: str, new: str, encoding: str):
    trc.write_bytes(trc.read_text().replace(old, new).encode(encoding))
    found = read_trc(trc)
    assert (found.names, found.frame_rate, found.first_frame) == (("LASI", "RASI"), 120.0, None)
    np.testing.assert_allclose(found.places, PLACES, atol=1e-6)


def test_times_may_be_rounded_and_begin_at_any_number(trc: Path):
    head, rows = trc.read_text().splitlines()[:6], trc.read_text().splitlines()[6:]
    for decimals, start in ((2, 0.0), (3, -0.5), (6, 1.7e9)):
        moved = [row.split("\t") for row in rows]
        for t, cells in enumerate(moved):
            cells[1] = f"{start + t / 120:.{decimals}f}"
        trc.write_text("\n".join(head + ["\t".join(cells) for cells in moved]))
        assert read_trc(trc).first_frame == (round(start * 120) or None)


def test_a_c3d_file_whose_first_frame_is_number_0(tmp_path: Path):
    write_c3d(tmp_path / "walk.c3d", POINTS)
    data = bytearray((tmp_path / "walk.c3d").read_bytes())
    struct.pack_into("<HH", data, 6, 0, 39)
    place = data.index(b"ACTUAL_START_FIELD") + len("ACTUAL_START_FIELD") + 5
    struct.pack_into("<HH", data, place, 0, 0)
    (tmp_path / "walk.c3d").write_bytes(data)
    np.testing.assert_allclose(read_c3d(tmp_path / "walk.c3d").places, PLACES, atol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("said", [True, False])
def test_a_c3d_file_of_more_frames_than_its_header_can_count(tmp_path: Path, said: bool):
    """Where no parameter says more, as in files of ezc3d, the header's 65535 are taken."""
    places = np.random.default_rng(1).normal(0, 0.3, (65600, 1, 3))
    write_c3d(tmp_path / "day.c3d", NamedPoints(names=("LASI",), places=places, frame_rate=120.0))
    if not said:
        data = (tmp_path / "day.c3d").read_bytes()
        for name in (b"ACTUAL_END_FIELD", b"LONG_FRAMES"):
            data = data.replace(name, name[::-1], 1)
        (tmp_path / "day.c3d").write_bytes(data)
    found = read_c3d(tmp_path / "day.c3d").places
    np.testing.assert_allclose(found, places if said else places[:65535], atol=1e-6)


@pytest.mark.filterwarnings("ignore:No analog data")
def test_a_c3d_file_whose_parameters_are_single_numbers_and_texts(tmp_path: Path):
    """ANALOG:SCALE as NDI's programs write it, and the label of a single point."""
    writer = c3d.Writer(point_rate=120.0, point_units="mm")
    writer.set_start_frame(1)
    writer.point_group.set_str("LABELS", "", "LASI", 4)
    writer.set_analog_labels([""])
    one = np.float32(0.5).tobytes()
    # The package writes no such file: it gets its name on the disk.
    writer.get_create("ANALOG").add_param("SCOLE", desc="", bytes_per_element=4, bytes=one, dimensions=[])
    writer.add_frames([(np.array([[1.0, 2.0, 3.0, 0.0, 0.0]], np.float32), np.zeros((0, 0)))])
    with (tmp_path / "walk.c3d").open("wb") as file:
        writer.write(file)
    data = (tmp_path / "walk.c3d").read_bytes().replace(b"SCALE", b"OTHER").replace(b"SCOLE", b"SCALE")
    (tmp_path / "walk.c3d").write_bytes(data)
    found = read_c3d(tmp_path / "walk.c3d")
    assert found.names == ("LASI",)
    np.testing.assert_allclose(found.places, [[[0.001, 0.002, 0.003]]])


def test_what_fails_leaves_nothing(tmp_path: Path):
    with pytest.raises(UnicodeEncodeError):
        write_trc(tmp_path / "walk.trc", NamedPoints(names=("Hüfte",), places=PLACES[:, :1], frame_rate=120.0))
    with pytest.raises(AssertionError):
        write_c3d(tmp_path / "walk.c3d", NamedPoints(names=("Hüfte",), places=PLACES[:, :1], frame_rate=120.0))
    assert not list(tmp_path.iterdir())
