"""Files in the forms of VPoser 1 and 2, with random weights: read right, refused right, and never run."""

import os
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from fitting_core.errors import InputError
from fitting_core.priors.files import registry
from fitting_core.priors.files.vposer import read_vposer
from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.pose import make_prior
from tests.fitting_core.priors.networks import random_latents, rotations_by_hand

HIDDEN, LATENT = 40, 32
ROTATIONS = torch.ones(189, HIDDEN)
"""The last weight of a decoder that puts out whole matrices."""


class Mean(nn.Module):
    """The encoder's last part: mean and variance; only the mean is used here."""

    def __init__(self) -> None:
        super().__init__()
        self.mu, self.logvar = nn.Linear(HIDDEN, LATENT), nn.Linear(HIDDEN, LATENT)

    def forward(self, x: Tensor) -> Tensor:
        return self.mu(x)


def version_1() -> nn.ModuleDict:
    slope = 0.2
    encoder = [
        ("bn1", nn.BatchNorm1d(63)), ("fc1", nn.Linear(63, HIDDEN)), ("a1", nn.LeakyReLU(slope)),
        ("bn2", nn.BatchNorm1d(HIDDEN)), ("fc2", nn.Linear(HIDDEN, HIDDEN)), ("a2", nn.LeakyReLU(slope)),
        ("mu", nn.Linear(HIDDEN, LATENT)),
    ]  # fmt: skip
    decoder = [
        ("fc1", nn.Linear(LATENT, HIDDEN)), ("a1", nn.LeakyReLU(slope)),
        ("fc2", nn.Linear(HIDDEN, HIDDEN)), ("a2", nn.LeakyReLU(slope)),
        ("out", nn.Linear(HIDDEN, 126)),
    ]  # fmt: skip
    parts = {"enc": encoder, "dec": decoder}
    return nn.ModuleDict({name: nn.Sequential(OrderedDict(modules)) for name, modules in parts.items()})


def version_2() -> nn.ModuleDict:
    encoder = [
        nn.Flatten(), nn.BatchNorm1d(63), nn.Linear(63, HIDDEN), nn.LeakyReLU(), nn.BatchNorm1d(HIDDEN),
        nn.Dropout(0.1), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, HIDDEN), Mean(),
    ]  # fmt: skip
    decoder = [
        nn.Linear(LATENT, HIDDEN), nn.LeakyReLU(), nn.Dropout(0.1), nn.Linear(HIDDEN, HIDDEN), nn.LeakyReLU(),
        nn.Linear(HIDDEN, 126),
    ]  # fmt: skip
    return nn.ModuleDict({"enc": nn.Sequential(*encoder), "dec": nn.Sequential(*decoder)})


def trained(make: Callable[[], nn.ModuleDict], seed: int = 0) -> nn.ModuleDict:
    """Random weights, with batch statistics that are not those of a fresh module."""
    torch.manual_seed(seed)
    networks = make().requires_grad_(False)
    for module in networks.modules():
        if isinstance(module, nn.BatchNorm1d):
            for values in (module.weight, module.bias, module.running_mean, module.running_var):
                assert values is not None
                values += 0.5 * torch.rand_like(values)
    return networks.eval()


def weights_1(networks: nn.ModuleDict) -> dict[str, Tensor]:
    named = {f"bodyprior_{k.replace('.', '_', 1)}": v for k, v in networks.state_dict().items()}
    return named | {"bodyprior_enc_logvar.weight": torch.zeros(LATENT, HIDDEN)}


def weights_2(networks: nn.ModuleDict, prefix: str = "vp_model.") -> dict[str, Tensor]:
    nets = {"enc": "encoder_net", "dec": "decoder_net"}
    return {prefix + nets[k[:3]] + k[3:]: v for k, v in networks.state_dict().items()}


def check_same(path: Path, networks: nn.ModuleDict, title: str) -> None:
    network = read_vposer(path)
    assert network.title == title and network.size == LATENT and "non-commercial" in network.licence
    prior, z = LatentPrior(network), random_latents(9)
    expected = rotations_by_hand(networks["dec"](z.float()).double())
    torch.testing.assert_close(prior.rotations(z), expected, rtol=0, atol=1e-5)
    pose = 0.5 * random_latents(9, 63)
    torch.testing.assert_close(prior._encoder(pose), networks["enc"](pose.float()).double(), rtol=1e-5, atol=1e-5)


class Configer(dict):
    """A class of the training's, which nobody has who reads the file."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(settings)
        self.path = "/training"


class Callback:
    """Stands in the checkpoint as a class."""


def lightning(networks: nn.ModuleDict) -> dict[str, Any]:
    # A transposed and a shared tensor: what optimisers and body models leave in a checkpoint.
    body = torch.arange(12.0).view(3, 4)
    return {
        "epoch": 8,
        "pytorch-lightning_version": "1.1.8",
        "callbacks": {Callback: {"best_model_score": torch.tensor(0.03)}},
        "optimizer_states": [{"state": {0: {"step": 5, "exp_avg": body.T}}, "param_groups": []}],
        "hyper_parameters": Configer(data=Configer(steps=3), names={"a"}),
        "state_dict": weights_2(networks) | {"bm_train.template": body.T, "bm_train.same": body},
    }


def folder_1(folder: Path, networks: nn.ModuleDict, *, legacy: bool = False, epoch: int = 96) -> Path:
    snapshot = folder / "snapshots" / f"TR00_E{epoch:03}.pt"
    snapshot.parent.mkdir(parents=True, exist_ok=True)
    (folder / "TR00_004_00_WO_accad.ini").write_text("[All]\nnum_neurons = 512\n")
    torch.save(weights_1(networks), snapshot, _use_new_zipfile_serialization=not legacy)
    return folder


def folder_2(folder: Path, networks: nn.ModuleDict, *, legacy: bool = False, epoch: int = 8) -> Path:
    snapshot = folder / "snapshots" / f"V02_05_epoch={epoch:02}_val_loss=0.03.ckpt"
    snapshot.parent.mkdir(parents=True, exist_ok=True)
    (folder / "V02_05.yaml").write_text("model_params:\n  num_neurons: 512\n")
    torch.save(lightning(networks), snapshot, _use_new_zipfile_serialization=not legacy)
    return folder


def zipped(folder: Path) -> Path:
    archive = folder.with_name(f"{folder.name}.zip")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as out:
        for file in sorted(folder.rglob("*")):
            out.write(file, Path(folder.name) / file.relative_to(folder))
    return archive


PLACES: dict[str, Callable[[Path], Path]] = {
    "folder": lambda folder: folder,
    "folder above": lambda folder: folder.parent,
    "snapshot": lambda folder: next((folder / "snapshots").iterdir()),
    "download": zipped,
}


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("version", [1, 2])
def test_reads_every_form(tmp_path: Path, version: int, place: str, legacy: bool):
    write, make = {1: (folder_1, version_1), 2: (folder_2, version_2)}[version]
    networks = trained(make)
    folder = write(tmp_path / "prior", networks, legacy=legacy)
    check_same(PLACES[place](folder), networks, f"VPoser {version}")


class Evil:
    """An object whose unpickling would make a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.system, (f"touch {self.path}",)


@pytest.mark.parametrize("legacy", [False, True])
def test_a_pickle_runs_nothing(tmp_path: Path, legacy: bool):
    mark = tmp_path / "made"
    networks = trained(version_2)
    folder = folder_2(tmp_path / "V02_05", networks, legacy=legacy)
    snapshot = PLACES["snapshot"](folder)
    content = lightning(networks) | {"callbacks": Evil(mark), "more": [Evil(mark)]}
    torch.save(content, snapshot, _use_new_zipfile_serialization=not legacy)
    check_same(folder, networks, "VPoser 2")
    assert not mark.exists()
    torch.save(Evil(mark), snapshot, _use_new_zipfile_serialization=not legacy)
    with pytest.raises(InputError, match="none is named as VPoser's decoder"):
        read_vposer(folder)
    snapshot.write_bytes(pickle.dumps(Evil(mark)))
    with pytest.raises(InputError, match="is not a checkpoint of torch"):
        read_vposer(folder)
    assert not mark.exists()
    pickle.loads(snapshot.read_bytes())
    assert mark.exists(), "the object does what it is made for"


def test_members_outside_of_the_archive_are_refused(tmp_path: Path):
    snapshot = PLACES["snapshot"](folder_1(tmp_path / "prior", trained(version_1)))
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as out:
        out.write(snapshot, "../../TR00_E096.pt")
    with pytest.raises(InputError, match="points outside"):
        read_vposer(tmp_path / "bad.zip")


def without(name: str) -> Callable[[dict[str, Any]], None]:
    return lambda weights: weights.pop(name)


def replaced(name: str, value: Tensor) -> Callable[[dict[str, Any]], None]:
    return lambda weights: weights.update({name: value})


DAMAGES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no tensor": (lambda weights: weights.clear(), "found none"),
    "another network": (without("bodyprior_dec_out.weight"), "none is named as VPoser's decoder"),
    "missing": (without("bodyprior_enc_fc2.bias"), "no tensor bodyprior_enc_fc2.bias"),
    "no batch statistics": (without("bodyprior_enc_bn1.running_var"), "no tensor bodyprior_enc_bn1.running_var"),
    "rotation matrices": (
        lambda w: w.update({"bodyprior_dec_out.weight": ROTATIONS, "bodyprior_dec_out.bias": ROTATIONS[:, 0]}),
        "puts out 189 numbers, expected 126",
    ),
    "other sides": (replaced("bodyprior_dec_fc2.weight", torch.ones(HIDDEN, 9)), "takes 9 numbers"),
    "batch statistics": (replaced("bodyprior_enc_bn2.weight", torch.ones(3)), r"bn2 has \(3,\) numbers"),
    "negative variance": (replaced("bodyprior_enc_bn1.running_var", -torch.ones(63)), "negative variances"),
    "whole numbers": (replaced("bodyprior_dec_fc1.bias", torch.ones(HIDDEN, dtype=torch.int64)), "is int64 of shape"),
    "not finite": (replaced("bodyprior_dec_fc1.bias", torch.full((HIDDEN,), torch.nan)), "not finite numbers"),
    "an unknown type": (replaced("bodyprior_dec_fc1.bias", torch.ones(HIDDEN) * 1j), "a storage without numbers"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_wrong_weights_are_refused(tmp_path: Path, damage: str):
    weights = weights_1(trained(version_1))
    change, message = DAMAGES[damage]
    change(weights)
    torch.save(weights, tmp_path / "TR00_E096.pt")
    with pytest.raises(InputError, match=message) as caught:
        read_vposer(tmp_path)
    assert "TR00_E096.pt" in str(caught.value)


@pytest.mark.parametrize("legacy", [False, True])
def test_cut_off_and_damaged_files_end_in_an_input_error(tmp_path: Path, legacy: bool):
    """Wherever the end is missing; a file with changed bytes may also be read."""
    snapshot = PLACES["snapshot"](folder_1(tmp_path / "prior", trained(version_1), legacy=legacy))
    whole, rng = snapshot.read_bytes(), np.random.default_rng(0)
    for kept in np.linspace(0, len(whole) - 100, 40).astype(int):
        snapshot.write_bytes(whole[:kept])
        with pytest.raises(InputError):
            read_vposer(tmp_path)
    start, refused = whole.index(b"bodyprior"), 0  # the pickle is here
    for _ in range(300):
        damaged = bytearray(whole)
        for place in rng.integers(max(start - 60, 0), start + 3000, 3):
            damaged[place] = rng.integers(256)
        snapshot.write_bytes(damaged)
        try:
            read_vposer(snapshot)
        except InputError:
            refused += 1
    assert refused > 100


def test_a_tensor_that_looks_outside_of_its_storage_is_refused(tmp_path: Path):
    """Offsets and strides of a forged pickle must not read other memory."""
    weights = weights_1(trained(version_1))
    torch.save(weights, tmp_path / "TR00_E096.pt")
    with zipfile.ZipFile(tmp_path / "TR00_E096.pt") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    pickled = next(name for name in members if name.endswith("data.pkl"))
    forged = members[pickled].replace(
        b"K" + bytes([HIDDEN]) + b"\x85", b"M\x00\x20\x85"
    )  # the biases' (40,) -> (8192,)
    assert forged != members[pickled]
    with zipfile.ZipFile(tmp_path / "TR00_E096.pt", "w") as archive:
        for name, data in (members | {pickled: forged}).items():
            archive.writestr(name, data)
    with pytest.raises(InputError, match=r"shape \(8192,\) in a storage of 40 numbers"):
        read_vposer(tmp_path)


def test_other_files_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="does not exist"):
        read_vposer(tmp_path / "missing")
    (tmp_path / "V02_05.yaml").write_text("a: 3")
    with pytest.raises(InputError, match=r"holds no VPoser \(found V02_05.yaml\), expected snapshots/TR00_E096.pt"):
        read_vposer(tmp_path)
    (tmp_path / "x.ckpt").write_text("no checkpoint")
    with pytest.raises(InputError, match="is not a checkpoint of torch"):
        read_vposer(tmp_path)
    with zipfile.ZipFile(tmp_path / "x.ckpt", "w") as out:
        out.writestr("a.txt", "a")
    with pytest.raises(InputError, match=r"a zip without the data\.pkl"):
        read_vposer(tmp_path)


def test_registered_vposer_is_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(registry, "user_file", lambda: tmp_path / "user" / "vposer.npz")
    like = {"dtype": torch.float64, "device": "cpu"}
    with pytest.raises(InputError, match="no VPoser was added yet"):
        make_prior("vposer", **like)
    first, second = (trained(version_1), trained(version_2))
    assert registry.register_vposer(zipped(folder_1(tmp_path / "vposer_v1_0", first))).title == "VPoser 1"
    added = registry.register_vposer(folder_2(tmp_path / "V02_05", second))
    assert (added.name, added.title, added.origin) == ("vposer", "VPoser 2", "user")
    assert [prior for prior in registry.list_priors() if prior.origin == "user"] == [added]
    by_name, by_path = make_prior("vposer", **like), make_prior(str(tmp_path / "V02_05"), **like)
    assert by_name.title == by_path.title and by_name.title.startswith("VPoser 2 (")
    torch.testing.assert_close(by_name.decode(random_latents(3)), by_path.decode(random_latents(3)), rtol=0, atol=0)
    assert [file.name for file in (tmp_path / "user").iterdir()] == ["vposer.npz"]
