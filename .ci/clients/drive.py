"""Drives the service with the generated Python client, then runs the command behind: drive.py BINARY COMMAND..."""

import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from chladni_client import Client
from chladni_client.api.clouds import post_cloud
from chladni_client.api.jobs import show_job
from chladni_client.api.results import bases_npy, spectrum_csv
from chladni_client.types import File

BASES = 12
SCAN = Path(__file__).resolve().parents[2] / "../shared/data/igea.ply"


def scan(binary, folder):
    if SCAN.exists():
        return SCAN
    print("SKIPPED: no scan at hand, a sample takes its place")
    path = folder / "sample.ply"
    subprocess.run([binary, "sample", "bumpy-sphere", "--points", "5000", "-o", path], check=True)
    return path


def drive(address, path):
    client = Client(base_url=address, timeout=120, raise_on_unexpected_status=True)
    with path.open("rb") as file:
        submitted = post_cloud.sync(client=client, body=File(payload=file, file_name=path.name), bases=BASES)
    job = submitted.job
    while job.state.value in ("queued", "running"):
        job = show_job.sync(job.id, client=client, wait=30)
    assert job.state.value == "succeeded", job
    answer = bases_npy.sync(job.id, client=client)
    bases = np.load(io.BytesIO(answer.payload.read()))
    assert bases.shape == (submitted.cloud.points, BASES) and np.isfinite(bases[:, 0]).any(), bases.shape
    lines = spectrum_csv.sync(job.id, client=client).splitlines()
    assert len(lines) == BASES + 1, lines
    print(f"Python: {path.name}, {bases.shape[0]} points, {bases.shape[1]} bases as {bases.dtype}")


def main(binary, *command):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flags = ["--listen", "127.0.0.1:0", "--disk-floor", "0", "--database", folder / "test.db"]
        service = subprocess.Popen(
            [binary, "serve", *flags], stdout=subprocess.PIPE, text=True, env={**os.environ, "CHLADNI_LOG": "warn"}
        )
        try:
            address = next(word for word in service.stdout.readline().split() if word.startswith("http://"))
            path = scan(binary, folder)
            drive(address, path)
            subprocess.run([*command, address, path], check=True)
        finally:
            service.terminate()
            service.wait()


main(str(Path(sys.argv[1]).resolve()), *sys.argv[2:])
