#!/usr/bin/env python3
"""Asks the running service whether it does what openapi.yaml says: no server errors, no answer outside of its schema.

Usage: schemathesis.py BINARY, in an environment that has schemathesis. Two passes, each bounded in examples: every
operation with whatever can be made up, sequences of operations too; then every reading operation on a cloud and on jobs
that are there.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import urllib.request

CHECKS = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "allow_header_conformance",
    "ensure_resource_availability",
    "use_after_free",
]
# The same every time: a run that fails can be repeated.
SEED = "6"
EXAMPLES = os.environ.get("CHLADNI_SCHEMATHESIS_EXAMPLES", "10")
POINTS = 12


def tool(name):
    return str(pathlib.Path(sys.executable).with_name(name))


def ask(address, path, method="GET", body=None):
    request = urllib.request.Request(address + path, data=body, method=method)
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def cloud():
    """Points on a closed surface, none like another."""
    rows = []
    for i in range(POINTS):
        for j in range(POINTS):
            rows.append(f"{i / POINTS:.3f} {j / POINTS:.3f} {((i * 7 + j * 3) % 5) / 500:.4f}")
    return ("\n".join(rows) + "\n").encode()


def finished(address, query):
    submitted = ask(address, f"/clouds?format=xyz&operator=voronoi&{query}", "POST", cloud())
    job = submitted["job"]["id"]
    while True:
        state = ask(address, f"/jobs/{job}?wait=30")["state"]
        if state == "succeeded":
            return submitted["cloud"]["id"], job
        assert state in ("queued", "running"), state


def overrides(address):
    """Ids that exist in place of made-up ones."""
    cloud_id, eigen = finished(address, "bases=6")
    _, operator = finished(address, "kind=operator")
    lines = []
    for include, parameters in [
        ("/clouds/.*", {"id": cloud_id}),
        ("/jobs/.*", {"id": eigen, "other": eigen, "file": "spectrum.csv"}),
        ("/jobs/.*/(laplacian|operator)", {"id": operator}),
    ]:
        lines += ["[[operations]]", f'include-path-regex = "^{include}"', "[operations.parameters]"]
        lines += [f'"path.{name}" = "{value}"' for name, value in parameters.items()]
    return "\n".join(lines) + "\n"


def run(address, folder, config, *options):
    (folder / "schemathesis.toml").write_text(config)
    document = pathlib.Path(__file__).resolve().parent.parent / "openapi.yaml"
    command = [tool("schemathesis"), "--config-file", str(folder / "schemathesis.toml"), "run", str(document)]
    command += ["--url", address, "--checks", ",".join(CHECKS), "--seed", SEED, "--max-examples", EXAMPLES]
    command += ["--continue-on-failure", "--warnings", "off", "--suppress-health-check", "all", *options]
    return subprocess.run(command, cwd=folder).returncode


def main(binary):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        flags = ["--listen", "127.0.0.1:0", "--disk-floor", "0", "--database", str(folder / "test.db")]
        log = open(folder / "log", "w+")
        service = subprocess.Popen(
            [str(pathlib.Path(binary).resolve()), "serve", *flags],
            stdout=subprocess.PIPE, stderr=log, text=True, env={**os.environ, "CHLADNI_LOG": "warn"},
        )
        try:
            address = next(word for word in service.stdout.readline().split() if word.startswith("http://"))
            failed = run(address, folder, "", "--phases", "examples,coverage,fuzzing,stateful")
            ids = overrides(address)
            failed |= run(address, folder, ids, "--phases", "coverage,fuzzing", "--exclude-method", "DELETE")
        finally:
            service.terminate()
            service.wait()
        log.seek(0)
        errors = [line for line in log if "ERROR" in line]
        print("".join(errors) or "no error in the service's log")
        return 1 if failed or errors else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
