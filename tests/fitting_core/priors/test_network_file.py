"""Pose priors as files of our own: what is written is read, and nothing else is."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.priors.files.network import Layer, PriorNetwork, read_prior_network, write_prior_network
from tests.fitting_core.priors.networks import random_network


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_round_trip(tmp_path: Path, dtype: type):
    network = random_network("leaky_relu_0.01", size=5, hidden=7)
    write_prior_network(tmp_path / "a.npz", network, dtype=dtype, notes="made up")
    again = read_prior_network(tmp_path / "a.npz")
    assert (again.title, again.licence, again.size) == ("random", "none", 5)
    for before, after in zip((*network.decoder, *network.encoder), (*again.decoder, *again.encoder), strict=True):
        assert before.activation == after.activation
        np.testing.assert_array_equal(after.weight, before.weight.astype(dtype))
        np.testing.assert_array_equal(after.bias, before.bias.astype(dtype))
    assert (again.hash == network.hash) == (dtype is np.float32)
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]


def with_layer(network: PriorNetwork, number: int, **changes: Any) -> tuple[Layer, ...]:
    layers = list(network.decoder)
    layers[number] = replace(layers[number], **changes)
    return tuple(layers)


def test_layers_that_do_not_fit_are_refused():
    network = random_network(size=5, hidden=7)
    middle = network.decoder[1].weight
    cases: dict[str, dict[str, Any]] = {
        "has no layer": {"encoder": ()},
        r"layer 1 of its decoder takes 6 numbers, but the one before puts out 7": {
            "decoder": with_layer(network, 1, weight=middle[:, :6])
        },
        r"weight of shape \(6, 7\) and a bias of shape \(7,\)": {"decoder": with_layer(network, 1, weight=middle[:6])},
        "not finite numbers": {"decoder": with_layer(network, 1, weight=middle * np.nan)},
        "activation 'relu', expected one of linear": {"decoder": with_layer(network, 1, activation="relu")},
        "puts out 7 numbers, expected 126": {"decoder": network.decoder[:2]},
        "takes 7 numbers, expected one of 63, 126, 189": {"encoder": network.encoder[1:]},
        "puts out 7 numbers, but its decoder takes 5": {"encoder": network.encoder[:1]},
    }
    for message, changes in cases.items():
        with pytest.raises(InputError, match=message):
            replace(network, **changes)


def changed(path: Path, **changes: Any) -> Path:
    """The file with other arrays; None takes one away, `about` changes entries of the text."""
    with np.load(path) as archive:
        arrays = dict(archive)
    about = json.loads(str(arrays["about"])) | changes.pop("about", {})
    arrays = arrays | {"about": np.array(json.dumps(about))} | changes
    np.savez(path, **{name: a for name, a in arrays.items() if a is not None})
    return path


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "version": ({"about": {"format": "tcfit pose prior 2"}}, "is 'tcfit pose prior 2', expected 'tcfit pose prior 1'"),
    "activation": ({"about": {"decoder": ["relu", "silu", "linear"]}}, "Invalid enum value 'relu'"),
    "unknown entry": ({"about": {"wheels": 4}}, "unknown field `wheels`"),
    "layer too few": ({"decoder_bias_1": None}, "lacks 'decoder_bias_1'"),
    "layer too many": ({"decoder_bias_3": np.zeros(3)}, "decoder_bias_3, which belongs to no layer"),
    "not finite": ({"encoder_bias_0": np.full(7, np.inf)}, "layer 0 of its encoder holds values that are not finite"),
    "whole numbers": ({"encoder_bias_0": np.zeros(7, int)}, "not finite numbers"),
    "pickled": ({"encoder_bias_0": np.array([None])}, "is not a complete npz archive"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_refused(tmp_path: Path, case: str):
    path = tmp_path / "prior.npz"
    write_prior_network(path, random_network(size=5, hidden=7))
    changes, message = BAD[case]
    with pytest.raises(InputError, match=message) as caught:
        read_prior_network(changed(path, **changes))
    assert str(path) in str(caught.value)


def test_other_files_are_refused(tmp_path: Path):
    path = tmp_path / "prior.npz"
    with pytest.raises(InputError, match="does not exist"):
        read_prior_network(path)
    np.savez(path, v_template=np.zeros(3))
    with pytest.raises(InputError, match="an npz of another kind"):
        read_prior_network(path)
    write_prior_network(path, random_network(size=5, hidden=7))
    whole = path.read_bytes()
    for bytes_ in (whole[: len(whole) // 2], b"", b"{}"):
        path.write_bytes(bytes_)
        with pytest.raises(InputError, match="is not a complete npz archive"):
            read_prior_network(path)
