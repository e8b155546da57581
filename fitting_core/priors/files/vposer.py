"""VPoser as downloaded (https://smpl-x.is.tue.mpg.de), versions 1 and 2, read without its code. Imports no torch.

Facts of both: 32 latent numbers, two hidden layers of 512, the decoder's output is 21 matrices 3 x 2, row by row. The
encoder takes 63 axis-angle numbers through batch normalisations. Version 1 has leaky ReLUs of slope 0.2, version 2
those of torch's default, 0.01.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.archives import Member, open_members
from fitting_core.files.torch_pickles import StoredTensor, checkpoint, numbers_of
from fitting_core.priors.files.network import Activation, Layer, PriorNetwork

SUFFIXES = (".pt", ".pth", ".ckpt")
"""Of the snapshots, wherever in a download they lie."""
MAX_BYTES = 2**30
"""Of a snapshot; Lightning's have the body model in them too."""
LICENCE = "VPoser's own: non-commercial research, see https://smpl-x.is.tue.mpg.de/modellicense.html"


@dataclass(frozen=True)
class _Step:
    """One layer by the names of its tensors, and of the batch normalisation before it."""

    linear: str
    activation: Activation = "linear"
    norm: str = ""


@dataclass(frozen=True, kw_only=True)
class _Version:
    title: str
    decoder: tuple[_Step, ...]
    encoder: tuple[_Step, ...]


_STEEP: Activation = "leaky_relu_0.2"
_FLAT: Activation = "leaky_relu_0.01"
VERSIONS = (
    _Version(
        title="VPoser 1",
        decoder=(_Step("bodyprior_dec_fc1", _STEEP), _Step("bodyprior_dec_fc2", _STEEP), _Step("bodyprior_dec_out")),
        encoder=(
            _Step("bodyprior_enc_fc1", _STEEP, norm="bodyprior_enc_bn1"),
            _Step("bodyprior_enc_fc2", _STEEP, norm="bodyprior_enc_bn2"),
            _Step("bodyprior_enc_mu"),
        ),
    ),
    _Version(
        title="VPoser 2",
        decoder=(_Step("decoder_net.0", _FLAT), _Step("decoder_net.3", _FLAT), _Step("decoder_net.5")),
        encoder=(
            _Step("encoder_net.2", _FLAT, norm="encoder_net.1"),
            _Step("encoder_net.6", norm="encoder_net.4"),
            _Step("encoder_net.7"),
            _Step("encoder_net.8.mu"),
        ),
    ),
)


def read_vposer(path: Path) -> PriorNetwork:
    """VPoser from its folder, a snapshot file, or the archive as downloaded.

    The tensors' names tell the version, not the files'. Of several snapshots the one of the latest epoch counts.

    Raises:
        InputError: VPoser is missing or damaged, or it is something else.
    """
    with open_members(path) as members:
        snapshots = members if path.is_file() and path.suffix.lower() in SUFFIXES else snapshots_among(members)
        if not snapshots:
            found = ", ".join(member.path.name for member in members[:6]) or "nothing"
            raise InputError(
                f"{path}: holds no VPoser (found {found}), expected snapshots/TR00_E096.pt of version 1 or "
                "snapshots/V02_05_epoch=....ckpt of version 2. Give the folder, the snapshot or the download itself."
            )
        try:
            return _network(_content(snapshots[0]))
        except InputError as error:
            raise InputError(f"{snapshots[0].path}: is not VPoser: {error}.") from error


def snapshots_among(members: list[Member]) -> list[Member]:
    """The snapshots in a folder or archive, that of the latest epoch first."""
    snapshots = [member for member in members if member.path.suffix.lower() in SUFFIXES]
    return sorted(snapshots, key=lambda member: (_epoch(member.path), str(member.path)), reverse=True)


def _epoch(path: PurePosixPath) -> int:
    """The epoch that a snapshot's name tells: TR00_E096, V02_05_epoch=08_val_loss=0.03; -1 without one."""
    found = re.search(r"(?:_E|epoch=)(\d+)", path.name)
    return int(found[1]) if found else -1


def _content(member: Member) -> dict[str, Callable[[], np.ndarray]]:
    """What reads each tensor of a snapshot, by its name."""
    if member.size > MAX_BYTES:
        raise InputError(f"it has {member.size / 2**30:.1f} GB, expected at most {MAX_BYTES / 2**30:.0f}")
    with member.open() as stream:
        content = checkpoint(stream.read(MAX_BYTES))
    table = content.get("state_dict", content) if isinstance(content, dict) else {}  # the former as Lightning has it
    pairs = table.items() if isinstance(table, dict) else ()
    return {
        name: partial(numbers_of, value)
        for name, value in pairs
        if isinstance(name, str) and isinstance(value, StoredTensor)
    }


def _network(tensors: Mapping[str, Callable[[], np.ndarray]]) -> PriorNetwork:
    for version in VERSIONS:
        last = f"{version.decoder[-1].linear}.weight"
        for prefix in (name.removesuffix(last) for name in tensors if name.endswith(last)):
            decoder, encoder = (
                tuple(_layer(step, prefix, tensors) for step in steps) for steps in (version.decoder, version.encoder)
            )
            return PriorNetwork(decoder=decoder, encoder=encoder, title=version.title, licence=LICENCE)
    found = ", ".join(list(tensors)[:4]) or "none"
    raise InputError(f"of its tensors (found {found}) none is named as VPoser's decoder")


def _layer(step: _Step, prefix: str, tensors: Mapping[str, Callable[[], np.ndarray]]) -> Layer:
    def read(name: str, axes: int = 1) -> np.ndarray:
        if prefix + name not in tensors:
            raise InputError(f"it has no tensor {prefix + name}")
        array = tensors[prefix + name]()
        if array.ndim != axes or array.dtype.kind != "f":
            raise InputError(f"its tensor {prefix + name} is {array.dtype} of shape {array.shape}")
        return array.astype(np.float64)

    layer = Layer(read(f"{step.linear}.weight", 2), read(f"{step.linear}.bias"), step.activation)
    if not step.norm:
        return layer
    norm = [read(f"{step.norm}.{name}") for name in ("weight", "bias", "running_mean", "running_var")]
    if wrong := [a.shape for a in norm if a.shape != layer.weight.shape[1:]]:
        raise InputError(f"its {step.norm} has {wrong[0]} numbers, but {step.linear} takes {layer.weight.shape[1]}")
    if (norm[3] < 0).any():
        raise InputError(f"its {step.norm} has negative variances")
    return layer.after_norm(*norm)
