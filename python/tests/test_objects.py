"""What comes back is at home in Python: pickled, copied, used by threads and by forked processes."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import chladni


@pytest.fixture(scope="module")
def basis(bumpy):
    return chladni.eigenbasis(chladni.Cloud(bumpy, fields={"height": bumpy[:, 2]}), k=8)


@pytest.mark.parametrize("twin", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy])
def test_a_basis_survives_pickling_and_copying(basis, twin):
    again = twin(basis)
    np.testing.assert_array_equal(again.vectors, basis.vectors)
    np.testing.assert_array_equal(again.filter(cutoff=5), basis.filter(cutoff=5))
    np.testing.assert_array_equal(again.cloud.fields["height"], basis.cloud.fields["height"])
    assert again.report == basis.report


def test_a_pickled_scan_is_written_as_it_was_read(tmp_path):
    points = np.array([2_600_000.0, 1_200_000.0, 450.0]) + 0.001 * np.arange(60).reshape(20, 3)
    chladni.write(tmp_path / "one.las", points, fields={"intensity": np.arange(20, dtype=np.uint16)})
    scan = chladni.read(tmp_path / "one.las")
    chladni.write(tmp_path / "two.las", scan)
    chladni.write(tmp_path / "three.las", pickle.loads(pickle.dumps(scan)))
    assert (tmp_path / "two.las").read_bytes() == (tmp_path / "three.las").read_bytes()


def test_the_arrays_of_a_cloud_are_read_only(basis):
    with pytest.raises(ValueError, match="read-only"):
        basis.cloud.points[0] = 0.0
    assert np.asarray(basis.cloud) is basis.cloud.points
    writable = np.array(basis.cloud)
    writable[0] = 0.0
    assert np.asarray(basis.cloud, dtype=np.float32).dtype == np.float32


def test_the_callers_array_is_left_alone(bumpy):
    points = bumpy.copy()
    cloud = chladni.Cloud(points)
    points[:] = 0.0
    np.testing.assert_array_equal(cloud.points, bumpy)


def test_other_threads_go_on_meanwhile():
    """The longest pause of a thread that only counts is short beside the computation."""
    pauses, ended = [], threading.Event()

    def count() -> None:
        last = time.monotonic()
        while not ended.is_set():
            time.sleep(0.001)
            now = time.monotonic()
            pauses.append(now - last)
            last = now

    counting = threading.Thread(target=count)
    counting.start()
    begin = time.monotonic()
    chladni.eigenbasis(chladni.sample("sphere", 20_000), k=100)
    seconds = time.monotonic() - begin
    ended.set()
    counting.join()
    assert max(pauses) < 0.5 * seconds, (max(pauses), seconds)


def test_several_threads_compute_at_once(bumpy):
    expected = chladni.eigenbasis(bumpy, k=6).vectors
    with ThreadPoolExecutor(4) as pool:
        for basis in pool.map(lambda _: chladni.eigenbasis(bumpy, k=6), range(4)):
            np.testing.assert_array_equal(basis.vectors, expected)


def _transformed(basis: chladni.Basis) -> np.ndarray:
    return basis.transform(chladni.eigenbasis(basis.cloud, k=3).vectors)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_forked_processes_compute(basis):
    """A pool of threads does not survive `fork`: what was computed before it must not matter."""
    expected = _transformed(basis)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        found = pool.apply_async(_transformed, (basis,)).get(timeout=60)
    np.testing.assert_array_equal(found, expected)
