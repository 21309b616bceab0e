"""What bases are for, and the directory of results, beside the command line: the same numbers, to the bit."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import command

import chladni


@pytest.fixture(scope="module")
def basis(bumpy):
    return chladni.eigenbasis(bumpy, k=30)


@pytest.fixture(scope="module")
def results(bumpy, tmp_path_factory):
    """The directory that the command line fills for the same cloud."""
    folder = tmp_path_factory.mktemp("results")
    np.save(folder / "cloud.npy", bumpy)
    command("analyze", folder / "cloud.npy", "--bases", 30, "--output", folder / "out")
    return folder / "out"


def test_the_command_line_finds_the_same_bits(basis, results):
    np.testing.assert_array_equal(basis.vectors, np.load(results / "bases.npy"))
    np.testing.assert_array_equal(basis.mass, np.load(results / "mass.npy"))
    assert basis.report == json.loads((results / "report.json").read_text())


def test_transform_filter_signatures_and_distances_are_the_command_lines(basis, results, tmp_path):
    coefficients = tmp_path / "coefficients.npy"
    command("coefficients", results, "--output", coefficients)
    np.testing.assert_array_equal(basis.transform(basis.cloud.points), np.load(coefficients))
    filtered = tmp_path / "filtered.npy"
    command("filter", results, "--filter", "low-pass", "--cutoff", 12, "--output", filtered)
    np.testing.assert_array_equal(basis.filter(kind="low-pass", cutoff=12), np.load(filtered))
    signatures = tmp_path / "signatures.npy"
    command("signatures", results, "--kind", "wks", "--count", 5, "--output", signatures)
    np.testing.assert_array_equal(basis.wks(5), np.load(signatures))
    distances = tmp_path / "distances.npy"
    command("distances", results, "--from", 3, "--output", distances)
    np.testing.assert_array_equal(basis.distances(3), np.load(distances).ravel())
    assert basis.invariants() == json.loads(command("invariants", results))
    found = json.loads(command("features", results))["features"]
    assert basis.features() == found and found


def test_saved_results_are_the_command_lines_own(basis, results, tmp_path):
    basis.save(tmp_path / "saved")
    again, theirs = chladni.load(tmp_path / "saved"), chladni.load(results)
    for one in (again, theirs):
        np.testing.assert_array_equal(one.vectors, basis.vectors)
        np.testing.assert_array_equal(one.cloud.points, basis.cloud.points)
        assert one.report == basis.report
    out = tmp_path / "filtered.npy"
    command("filter", tmp_path / "saved", "--cutoff", 7, "--output", out)
    np.testing.assert_array_equal(basis.filter(cutoff=7), np.load(out))


def test_synthesis_inverts_the_transform_in_the_span(basis):
    f = basis.vectors @ np.arange(30.0)
    np.testing.assert_allclose(basis.transform(f), np.arange(30.0), atol=1e-9)
    np.testing.assert_allclose(basis.synthesize(basis.transform(f)), f, atol=1e-9)
    np.testing.assert_allclose(basis.synthesize(np.eye(30)[:, :3]), basis.vectors[:, :3], atol=1e-12)


def test_gains_filter_as_their_kind_does(basis):
    f = basis.cloud.points[:, 0]
    by_kind = basis.filter(f, "low-pass", cutoff=10)
    by_gains = basis.filter(f, gains=[1.0] * 10)
    np.testing.assert_allclose(by_kind, by_gains, atol=1e-12)
    with pytest.raises(ValueError, match="cutoff"):
        basis.filter(f, "low-pass", cutoff=1e9)
    with pytest.raises(ValueError, match="low-pass"):
        basis.filter(f, "lowpass", cutoff=3)
    with pytest.raises(ValueError, match="finite in row 4"):
        basis.filter(np.where(np.arange(len(f)) == 4, np.nan, f), cutoff=3)


def test_heat_signatures_at_given_times_are_their_formula(basis):
    times = np.array([0.05, 0.4])
    expected = np.einsum("nk,kt->nt", basis.vectors**2, np.exp(-np.outer(np.maximum(basis.eigenvalues, 0), times)))
    np.testing.assert_allclose(basis.hks(times), expected, rtol=1e-12)
    with pytest.raises(ValueError, match="above 0"):
        basis.hks([-1.0])


def test_a_shape_is_like_itself_and_unlike_another(basis, sphere):
    assert basis.similarity(basis)["distance"] == 0.0
    other = chladni.eigenbasis(sphere, k=30)
    assert basis.similarity(other)["distance"] > 0.01


def test_pictures_are_png(basis):
    assert basis.image(4, width=80, height=60).startswith(b"\x89PNG")
    assert basis._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="modes 0 to 29"):
        basis.image(30)
    with pytest.raises(ValueError, match="pixels"):
        basis.image(3, width=0)
