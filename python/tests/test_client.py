"""The client against a service of its own."""

from __future__ import annotations

import http.server
import json
import re
import subprocess
import threading

import numpy as np
import pytest
from conftest import COMMAND

import chladni


@pytest.fixture(scope="module")
def url(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    call = [*COMMAND, "serve", "--listen", "127.0.0.1:0", "--database", folder / "chladni.db"]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(r"127\.0\.0\.1:(\d{2,5})", line):
            threading.Thread(target=process.stdout.read, daemon=True).start()
            yield f"http://127.0.0.1:{found[1]}"
            break
    process.terminate()
    process.wait(timeout=30)


def test_arrays_go_there_and_bases_come_back(url, bumpy):
    client = chladni.Client(url)
    told = []
    job = client.upload(bumpy, bases=12).wait(progress=lambda share, phase: told.append(share))
    found = job.bases()
    here = chladni.eigenbasis(bumpy, k=12)
    np.testing.assert_array_equal(found.vectors, here.vectors)
    np.testing.assert_array_equal(found.points, bumpy)
    np.testing.assert_allclose(found.eigenvalues, here.eigenvalues, rtol=1e-15)
    np.testing.assert_array_equal(job.filtered(filter="low-pass", cutoff=5), here.filter(cutoff=5))
    assert len(job.spectrum()["eigenvalues"]) == 12 and job.image(3).startswith(b"\x89PNG")
    assert client.job(job.id).state["state"] == "succeeded"
    assert job.id in [other.id for other in client.jobs()]
    assert "operators" in json.dumps(client.capabilities())


def test_files_are_uploaded_as_they_are(url, bumpy, tmp_path):
    chladni.write(tmp_path / "cloud.ply", bumpy)
    job = chladni.Client(url).upload(tmp_path / "cloud.ply", bases=5, operator="voronoi").wait()
    assert job.bases(first=1, count=2).vectors.shape == (len(bumpy), 2)


def test_clouds_go_with_their_fields_and_faces(url, bumpy):
    cloud = chladni.Cloud(bumpy, faces=[[0, 1, 2]], fields={"height": bumpy[:, 2]})
    job = chladni.Client(url).upload(cloud, bases=5).wait()
    found = json.loads(chladni.Client(url).request("GET", f"/clouds/{job.state['cloud_id']}"))
    assert found["faces"] == 1 and [field["name"] for field in found["fields"]] == ["height"]


def test_all_columns_of_an_array_are_coordinates(url):
    torus = chladni.sample("flat-torus-4", 500).points
    assert chladni.Client(url).upload(torus, bases=3).wait().bases().points.shape == (500, 4)


def test_a_job_can_be_canceled_and_waiting_has_an_end(url):
    client = chladni.Client(url)
    job = client.upload(chladni.sample("bumpy-sphere", 60_000), bases=400)
    with pytest.raises(TimeoutError, match=job.id):
        job.wait(seconds=0.5)
    job.cancel()
    with pytest.raises(chladni.ServiceError, match="canceled"):
        job.wait(seconds=60)


def test_refusals_are_errors_with_the_services_words(url, bumpy):
    client = chladni.Client(url)
    with pytest.raises(chladni.ServiceError, match="bases") as refused:
        client.upload(bumpy, basis=3)
    assert refused.value.status == 422 and refused.value.problem["nearest"] == "bases"
    with pytest.raises(chladni.ServiceError) as unknown:
        client.job("01a202c1-ce94-74e9-a1f0-64a67481b9d1")
    assert unknown.value.status == 404


def test_a_busy_service_is_asked_again_under_the_same_key():
    seen: list[tuple[str, bytes]] = []

    class Busy(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            seen.append((self.headers["Idempotency-Key"], body))
            answer = json.dumps({"job": {"id": "1", "state": "queued"}}).encode()
            self.send_response(202 if len(seen) > 2 else (429, 503)[len(seen) - 1])
            self.send_header("Retry-After", "0.1")
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Busy)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    job = chladni.Client(address).upload(np.eye(3))
    assert job.id == "1" and len(seen) == 3
    assert len({key for key, _ in seen}) == 1 and len({body for _, body in seen}) == 1
    seen.clear()
    with pytest.raises(chladni.ServiceError) as busy:
        chladni.Client(address, retry_seconds=0.0).upload(np.eye(3))
    assert busy.value.status == 429
    server.shutdown()
