"""Where bodies are found, and how downloads become registered bodies."""

import io
import shutil
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.files import registry
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import ENVIRONMENT, find_body, list_bodies, register
from fitting_core.errors import InputError
from fitting_core.files import archives
from tests.samples.body_files import VERTICES, body_arrays, write_npz, write_pickle, write_smpl_pickle


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty user folder, and one free body in place of those that come with tcfit."""
    folder = tmp_path / "data" / "bodies"
    monkeypatch.setattr(registry, "user_folder", lambda: folder)
    monkeypatch.setattr(registry, "FREE_FOLDER", tmp_path / "free")
    monkeypatch.delenv(ENVIRONMENT, raising=False)
    write_npz(tmp_path / "free" / "SMPLX_NEUTRAL.npz", body_arrays())
    return folder


@pytest.fixture
def downloads(tmp_path: Path, official: Path) -> Path:
    """The test's own copy of `official`."""
    return shutil.copytree(official, tmp_path / "downloads")


@pytest.fixture(scope="module")
def official(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders as the official downloads unpack to, with small bodies."""
    root = tmp_path_factory.mktemp("official")
    for gender in ("NEUTRAL", "MALE", "FEMALE"):
        write_npz(root / f"models/smplx/SMPLX_{gender}.npz", body_arrays())
        write_pickle(root / f"models/smplx/SMPLX_{gender}.pkl", body_arrays())
    (root / "models/smplx/version.txt").write_text("1.1")
    for letter, version in (("f", "0.0"), ("f", "1.0"), ("m", "1.0"), ("neutral", "1.0")):
        name = f"basicmodel_{letter}_lbs_10_207_0_v1.{version}.pkl"
        write_smpl_pickle(root / "SMPL_python_v.1.1.0/smpl/models" / name, body_arrays("smpl"))
    for gender in ("male", "female"):
        write_pickle(root / f"mano_v1_2/models/SMPLH_{gender}.pkl", body_arrays("smplh"))
        write_npz(root / f"smplh/{gender}/model.npz", body_arrays("smplh"))
    write_pickle(root / "mano_v1_2/models/MANO_LEFT.pkl", {"J_regressor": np.zeros((16, 778))})
    return root


def _zip(folder: Path) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder.parent))
    return path


def _names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def test_free_body_is_found_without_anything(user: Path, tmp_path: Path):
    assert find_body() == tmp_path / "free" / "SMPLX_NEUTRAL.npz"
    [body] = list_bodies()
    assert (body.kind, body.gender, body.origin, body.vertices) == ("smplx", "neutral", "free", VERTICES)


def test_order_of_places(user: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    given = write_npz(tmp_path / "given" / "SMPLX_NEUTRAL.npz", body_arrays())
    variable = write_npz(tmp_path / "variable" / "models" / "smplx" / "SMPLX_NEUTRAL.npz", body_arrays())
    registered = write_npz(user / "SMPLX_NEUTRAL.npz", body_arrays())
    assert find_body() == registered
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path / "variable"))
    assert find_body() == variable
    assert find_body(search=tmp_path / "given") == given
    assert find_body(search=given, gender="female") == given
    assert [body.path for body in list_bodies()] == [variable, registered, tmp_path / "free" / "SMPLX_NEUTRAL.npz"]
    assert [body.origin for body in list_bodies()] == ["user", "user", "free"]


def test_variable_that_names_no_folder_is_refused(user: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match=f"nowhere: is not a folder, but {ENVIRONMENT} names it"):
        find_body()


def test_given_folder_is_never_replaced_by_another(user: Path, tmp_path: Path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError) as error:
        find_body(search=tmp_path / "mine")
    message = str(error.value)
    assert "SMPLX_NEUTRAL.npz" in message and str(tmp_path / "mine") in message and str(user) not in message


@pytest.mark.parametrize(
    ("folder", "model", "gender", "expected"),
    [
        ("models", "smplx", "male", "models/smplx/SMPLX_MALE.npz"),
        ("", "smplh", "female", "smplh/female/model.npz"),
        ("mano_v1_2", "smplh", "male", "mano_v1_2/models/SMPLH_male.pkl"),
        ("", "smpl", "female", "SMPL_python_v.1.1.0/smpl/models/basicmodel_f_lbs_10_207_0_v1.1.0.pkl"),
        ("smplh", "smplh", "male", "smplh/male/model.npz"),
    ],
)
def test_official_folders_are_found_as_they_are(
    user: Path, downloads: Path, folder: str, model: str, gender: str, expected: str
):
    assert find_body(model=model, gender=gender, search=downloads / folder) == downloads / expected


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("models", ["SMPLX_FEMALE.npz", "SMPLX_MALE.npz", "SMPLX_NEUTRAL.npz"]),
        ("SMPL_python_v.1.1.0", ["SMPL_FEMALE.pkl", "SMPL_MALE.pkl", "SMPL_NEUTRAL.pkl"]),
        ("mano_v1_2", ["SMPLH_FEMALE.pkl", "SMPLH_MALE.pkl"]),
        ("smplh", ["SMPLH_FEMALE.npz", "SMPLH_MALE.npz"]),
    ],
)
def test_register_downloads(user: Path, downloads: Path, name: str, expected: list[str], packed: bool):
    path = downloads / name
    registered = register(_zip(path) if packed else path)
    assert _names(user) == expected
    assert sorted(body.path.name for body in registered) == expected
    assert all(body.origin == "user" and body.vertices == VERTICES for body in registered)
    body = registered[0]
    assert find_body(model=body.kind, gender=body.gender) == body.path
    assert load_body(body.path).kind == body.kind


def test_register_tar(user: Path, downloads: Path):
    """The extended SMPL-H comes as smplh.tar.xz with folders female and male at its top."""
    path = downloads / "smplh.tar.xz"
    with tarfile.open(path, "w:xz") as archive:
        for gender in ("female", "male"):
            archive.add(downloads / "smplh" / gender, f"./{gender}")
    register(path)
    assert _names(user) == ["SMPLH_FEMALE.npz", "SMPLH_MALE.npz"]


def test_register_one_file_of_any_name(user: Path, tmp_path: Path):
    register(write_npz(tmp_path / "my female body.npz", body_arrays()))
    assert _names(user) == ["SMPLX_FEMALE.npz"]
    with pytest.raises(InputError, match=r"body\.npz: its name does not tell the gender.*SMPLX_NEUTRAL\.npz"):
        register(write_npz(tmp_path / "body.npz", body_arrays()))
    register(write_npz(tmp_path / "body.npz", body_arrays() | {"gender": np.array("male")}))
    assert _names(user) == ["SMPLX_FEMALE.npz", "SMPLX_MALE.npz"]


def test_registering_again_replaces(user: Path, tmp_path: Path):
    register(write_npz(tmp_path / "SMPLX_NEUTRAL.npz", body_arrays(seed=1)))
    pickled = write_pickle(tmp_path / "SMPLX_NEUTRAL.pkl", body_arrays(seed=2))
    register(pickled)
    assert _names(user) == ["SMPLX_NEUTRAL.pkl"]
    assert find_body().read_bytes() == pickled.read_bytes()


def test_one_damaged_model_registers_nothing(user: Path, downloads: Path):
    path = downloads / "models/smplx/SMPLX_MALE.npz"
    path.write_bytes(path.read_bytes()[:3000])
    register(write_npz(downloads / "SMPLX_FEMALE.npz", body_arrays(seed=3)))
    before = (user / "SMPLX_FEMALE.npz").read_bytes()
    with pytest.raises(InputError, match=r"models/smplx/SMPLX_MALE\.npz|smplx/SMPLX_MALE\.npz") as error:
        register(downloads / "models")
    assert ".incoming" not in str(error.value)
    assert _names(user) == ["SMPLX_FEMALE.npz"]
    assert (user / "SMPLX_FEMALE.npz").read_bytes() == before


@pytest.mark.parametrize("name", ["../SMPLX_NEUTRAL.npz", "/SMPLX_NEUTRAL.npz", "a/../../x", "..\\x", "C:x"])
def test_archive_that_points_outside_is_refused(user: Path, tmp_path: Path, name: str):
    content = write_npz(tmp_path / "SMPLX_NEUTRAL.npz", body_arrays()).read_bytes()
    with zipfile.ZipFile(tmp_path / "models.zip", "w") as archive:
        archive.writestr("models/SMPLX_NEUTRAL.npz", content)
        archive.writestr(name, content)
    with tarfile.open(tmp_path / "models.tar", "w") as archive:
        info = tarfile.TarInfo(name)
        info.size = len(content)
        archive.addfile(info, io.BytesIO(content))
    for path in (tmp_path / "models.zip", tmp_path / "models.tar"):
        with pytest.raises(InputError, match="points outside"):
            register(path)
    assert not user.exists() or _names(user) == []


def test_links_in_a_tar_are_left_out(user: Path, tmp_path: Path):
    secret = write_npz(tmp_path / "secret.npz", body_arrays())
    with tarfile.open(tmp_path / "models.tar", "w") as archive:
        info = tarfile.TarInfo("SMPLX_NEUTRAL.npz")
        info.type, info.linkname = tarfile.SYMTYPE, str(secret)
        archive.addfile(info)
    with pytest.raises(InputError, match="holds no body model"):
        register(tmp_path / "models.tar")


def test_zip_bomb_is_refused(user: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with zipfile.ZipFile(tmp_path / "models.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SMPLX_NEUTRAL.npz", bytes(3_000_000))
    monkeypatch.setattr(archives, "MAX_MEMBER_BYTES", 2_000_000)
    with pytest.raises(InputError, match="unpacks to"):
        register(tmp_path / "models.zip")
    assert _names(user) == []


def test_tar_that_unpacks_too_large_is_refused(user: Path, downloads: Path, monkeypatch: pytest.MonkeyPatch):
    with tarfile.open(downloads / "smplh.tar.gz", "w:gz") as archive:
        archive.add(downloads / "smplh", "smplh")
    monkeypatch.setattr(archives, "MAX_LISTED_BYTES", 500_000)
    with pytest.raises(InputError, match="unpacks to more than"):
        register(downloads / "smplh.tar.gz")


def test_member_larger_than_it_declares_is_refused(tmp_path: Path):
    member = archives.Member(path=archives.PurePosixPath("a"), size=10, open=lambda: io.BytesIO(bytes(11)))
    with pytest.raises(InputError, match="more than the 10 bytes that it declares"):
        member.copy_to(tmp_path / "a")


def _encrypted(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SMPLX_NEUTRAL.npz", b"x")
    content = path.read_bytes()
    at = content.index(b"PK\x01\x02") + 8
    path.write_bytes(content[:6] + b"\x01\x00" + content[8:at] + b"\x01\x00" + content[at + 2 :])


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("none.zip", lambda p: None, "does not exist"),
        ("models.zip", lambda p: p.write_bytes(b"PK\x03\x04 cut"), "damaged or was cut off"),
        ("models.tar.xz", lambda p: p.write_bytes(b"\xfd7zXZ\x00 cut"), "damaged or was cut off"),
        ("models.zip", lambda p: zipfile.ZipFile(p, "w").close(), "holds no body model .found nothing"),
        ("models.zip", _encrypted, "encrypted.*Unpack it yourself"),
        ("photos", lambda p: (p.mkdir(), (p / "a.jpg").touch()), r"holds no body model .found a\.jpg"),
        ("SMPLX_NEUTRAL.npz", lambda p: p.write_bytes(b"x"), "not a complete npz archive"),
        ("notes.txt", lambda p: p.write_text("x"), r"holds no body model .found notes\.txt"),
    ],
)
def test_what_cannot_be_registered_is_explained(user: Path, tmp_path: Path, name: str, write, message: str):
    write(tmp_path / name)
    with pytest.raises(InputError, match=message):
        register(tmp_path / name)
    assert not user.exists() or _names(user) == []


def test_broken_bodies_are_listed_with_their_problem(user: Path, tmp_path: Path):
    user.mkdir(parents=True)
    (user / "SMPLX_MALE.npz").write_bytes(b"not a zip")
    broken, free = list_bodies()
    assert (broken.gender, broken.vertices) == ("male", 0) and "not a complete npz" in broken.problem
    assert (free.origin, free.problem) == ("free", "")


def test_folder_that_cannot_be_written_is_explained(user: Path, tmp_path: Path):
    user.parent.mkdir()
    user.write_text("a file where the folder should be")
    with pytest.raises(InputError, match="cannot be written"):
        register(write_npz(tmp_path / "SMPLX_NEUTRAL.npz", body_arrays()))


def test_motions_beside_models_are_not_taken_for_bodies(user: Path, tmp_path: Path):
    for name in (
        "SMPLX_NEUTRAL_walk.npz",
        "smplx/male/walk_stageii.npz",
        "dmpls/male/model.npz",
        ".hidden/SMPLX_MALE.npz",
    ):
        write_npz(tmp_path / "mixed" / name, {"poses": np.zeros((3, 165)), "trans": np.zeros((3, 3))})
    assert list_bodies(tmp_path / "mixed") == []
