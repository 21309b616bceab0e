"""What bases are for, and the directory of results, beside the command line: the same numbers, to the bit."""

from __future__ import annotations

import json
import struct

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
    command("signatures", results, "--kind", "hks", "--count", 4, "--scaled", "--output", signatures)
    np.testing.assert_array_equal(basis.hks(4, scaled=True), np.load(signatures))
    functions = tmp_path / "functions.npy"
    command("synthesis", results, coefficients, "--output", functions)
    np.testing.assert_array_equal(basis.synthesize(np.load(coefficients)), np.load(functions))
    distances = tmp_path / "distances.npy"
    command("distances", results, "--from", 3, "--output", distances)
    np.testing.assert_array_equal(basis.distances(3), np.load(distances).ravel())
    assert basis.invariants() == json.loads(command("invariants", results))
    found = json.loads(command("features", results))["features"]
    assert basis.features() == found and found


def test_saved_results_are_the_command_lines_own(basis, results, tmp_path):
    basis.save(tmp_path / "saved")
    again, theirs = chladni.load(tmp_path / "saved"), chladni.load(results)
    for name in ("mass.npy", "bases.npy", "bases.ply"):
        assert (tmp_path / "saved" / name).read_bytes() == (results / name).read_bytes()
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
    by_array = basis.filter(f, gains=np.ones(10))
    np.testing.assert_array_equal(by_array, by_gains)

def test_heat_signatures_at_given_times_are_their_formula(basis):
    times = np.array([0.05, 0.4])
    expected = np.einsum("nk,kt->nt", basis.vectors**2, np.exp(-np.outer(np.maximum(basis.eigenvalues, 0), times)))
    np.testing.assert_allclose(basis.hks(times), expected, rtol=1e-12)
    np.testing.assert_array_equal(basis.hks(0.05), basis.hks([0.05]))
    scaled = basis.hks(times, scaled=True)
    np.testing.assert_allclose(basis.mass @ scaled, 1.0, rtol=1e-9)


def test_numbers_of_scales_stand_for_scales(basis):
    for kind, signature in (("hks", basis.hks), ("wks", basis.wks)):
        scales = basis.scales(kind, 6)
        assert scales.shape == (6,)
        np.testing.assert_allclose(signature(6), signature(scales), rtol=1e-12)
        np.testing.assert_array_equal(signature(np.int64(6)), signature(6))


def test_a_shape_is_like_itself_and_unlike_another(basis, sphere):
    assert basis.similarity(basis)["distance"] == 0.0
    other = chladni.eigenbasis(sphere, k=30)
    assert basis.similarity(other)["distance"] > 0.01


def size(png: bytes) -> tuple[int, int]:
    """Width and height of a PNG, from its first chunk."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n") and png[12:16] == b"IHDR"
    return struct.unpack(">II", png[16:24])


def test_pictures_are_the_command_lines(basis, results, tmp_path):
    view = ["--azimuth", 30, "--up", "y", "--width", 200, "--height", 150, "--background", "black", "--legend"]
    for index, arguments in ((4, {"mode": 4}), (None, {})):
        theirs = tmp_path / f"{index}.png"
        command("render", results, *(() if index is None else ("--basis", index)), *view, "--output", theirs)
        ours = basis.image(**arguments, azimuth=30, up="y", width=200, height=150, background="black", legend=True)
        assert size(ours) == size(theirs.read_bytes()) == (200, 150)
        assert pixels(ours) == pixels(theirs.read_bytes())
    assert pixels(basis.image(4, width=80, height=60)) != pixels(basis.image(5, width=80, height=60))


def test_a_notebook_shows_a_basis(basis):
    assert size(basis._repr_png_()) == (480, 360)


def pixels(png: bytes) -> bytes:
    """The chunks that hold the picture: titles differ."""
    found, at = b"", 8
    while at < len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        if png[at + 4 : at + 8] == b"IDAT":
            found += png[at + 8 : at + 8 + length]
        at += 12 + length
    return found


def test_values_of_ones_own_color_a_cloud(basis):
    heights = basis.cloud.points[:, 2]
    shown = basis.image(values=heights.astype(np.float32), title="height", legend=True, width=120, height=90)
    assert pixels(shown) != pixels(basis.image(width=120, height=90))


def test_a_plane_cloud_comes_back_as_one(tmp_path):
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 2, 30)), axis=-1).reshape(-1, 2)
    basis = chladni.eigenbasis(grid, k=5)
    basis.save(tmp_path / "plane")
    again = chladni.load(tmp_path / "plane")
    np.testing.assert_array_equal(again.cloud.points, grid)
    np.testing.assert_array_equal(again.filter(cutoff=3), basis.filter(cutoff=3))


def test_a_directory_that_holds_no_bases_says_so(bumpy, tmp_path):
    np.save(tmp_path / "cloud.npy", bumpy)
    command("analyze", tmp_path / "cloud.npy", "--kind", "operator", "--output", tmp_path / "out")
    with pytest.raises(ValueError, match="without bases"):
        chladni.load(tmp_path / "out")
    with pytest.raises(FileNotFoundError):
        chladni.load(tmp_path / "absent")
