"""A client for the service: the standard library and NumPy only."""

from __future__ import annotations

import contextlib
import io
import json
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._cloud import Array, Cloud, numbers
from ._progress import Progress, Tell, told

# Answers that say "later": too many requests, no room at the moment.
_LATER = (429, 503)

# Seconds that one request waits for a job to move on: with somebody who watches, and without.
_WATCHED_SECONDS = 1.0
_UNWATCHED_SECONDS = 30.0


class ServiceError(Exception):
    """An answer that is an error: `status`, and the whole `problem` (RFC 9457) with its `detail`."""

    def __init__(self, status: int, problem: Mapping[str, Any]) -> None:
        """Take the status and the body of the answer."""
        super().__init__(status, problem)
        self.status = status
        self.problem = dict(problem)

    def __str__(self) -> str:
        """Give the status and the service's own words."""
        return f"{self.status}: {self.problem.get('detail') or self.problem.get('title') or 'no explanation'}"


class Bases(NamedTuple):
    """Bases as the service hands them out: `_, evals, _, evecs = bases`, or by name."""

    points: Array
    """Coordinates, n × d."""
    eigenvalues: Array
    """λ, (k,)."""
    mass: Array
    """Diagonal of M, (n,)."""
    vectors: Array
    """One basis per column, (n, k)."""


class Client:
    """A service at a URL, with a key where it asks for one.

    An answer of 429 or 503 is waited out as its `Retry-After` says, at most `retry_seconds` in all. Submissions carry an
    idempotency key, so that one that is sent again is stored once. Every other answer that is an error raises
    `ServiceError`; a service that cannot be reached, `urllib.error.URLError`.
    """

    def __init__(
        self, url: str, key: str | None = None, timeout: float = 90.0, retry_seconds: float = 300.0
    ) -> None:
        """Take the address; nothing is sent yet."""
        self.url = url.rstrip("/")
        self._key = key
        self._timeout = timeout
        self._retry_seconds = retry_seconds

    def upload(
        self, cloud: Cloud | str | PathLike[str] | ArrayLike, format: str | None = None, **parameters: Any
    ) -> Job:
        """Upload a file, a `Cloud` with its fields and faces, or an n × d array, and queue an analysis of it.

        `parameters` are those of the service: `operator="voronoi", bases=200`. A file is sent as it is, piece by piece.
        """
        if parameters.get("analyze", True) is not True:
            raise ValueError("upload queues an analysis; `request` can store a cloud without one")
        query: dict[str, Any] = {"format": format, **parameters}
        headers = {"Idempotency-Key": str(uuid.uuid4()), "Content-Type": "application/octet-stream"}
        if isinstance(cloud, (str, PathLike)):
            path = Path(cloud)
            answer = self._json("PUT", f"/clouds/{urllib.parse.quote(path.name)}", query, path, headers)
        elif isinstance(cloud, Cloud):
            query |= {"format": "ply", "nonfinite": parameters.get("nonfinite", "drop")}
            answer = self._json("POST", "/clouds", query, cloud._inner.to_ply(), headers)
        else:
            points = numbers(cloud, "cloud")
            if points.ndim != 2:
                raise ValueError(f"an array of the shape (n, d) is a cloud, not one of {points.shape}")
            buffer = io.BytesIO()
            np.save(buffer, points)
            query |= {"format": "npy", "coordinates": parameters.get("coordinates", points.shape[1])}
            answer = self._json("POST", "/clouds", query, buffer.getvalue(), headers)
        return Job(self, answer["job"])

    def job(self, id: str) -> Job:
        """Find a job by its id."""
        return Job(self, self._json("GET", f"/jobs/{urllib.parse.quote(id, safe='')}"))

    def jobs(self) -> Iterator[Job]:
        """List all jobs, newest first."""
        cursor = None
        while True:
            page = self._json("GET", "/jobs", {"cursor": cursor})
            yield from (Job(self, job) for job in page["jobs"])
            cursor = page.get("next")
            if cursor is None:
                return

    def capabilities(self) -> dict[str, Any]:
        """Say what the service offers, and its limits."""
        return dict(self._json("GET", "/capabilities"))

    def _json(
        self,
        method: str,
        path: str,
        query: Mapping[str, Any] | None = None,
        body: bytes | Path | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        return json.loads(self.request(method, path, query, body, headers))

    def request(
        self,
        method: str,
        path: str,
        query: Mapping[str, Any] | None = None,
        body: bytes | Path | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> bytes:
        """Send a request, its body from memory or from a file, and give the body of the answer."""
        given = {name: _argument(value) for name, value in (query or {}).items() if value is not None}
        url = self.url + path + ("?" + urllib.parse.urlencode(given) if given else "")
        sent = dict(headers or {})
        if self._key is not None:
            sent["Authorization"] = f"Bearer {self._key}"
        deadline = time.monotonic() + self._retry_seconds
        while True:
            try:
                return self._send(method, url, body, sent)
            except urllib.error.HTTPError as error:
                pause = _retry_after(error)
                if error.code not in _LATER or time.monotonic() + pause > deadline:
                    raise ServiceError(error.code, _problem(error)) from None
            time.sleep(pause)

    def _send(self, method: str, url: str, body: bytes | Path | None, headers: Mapping[str, str]) -> bytes:
        with contextlib.ExitStack() as opened:
            data: Any = body
            if isinstance(body, Path):
                data = opened.enter_context(body.open("rb"))
                headers = {**headers, "Content-Length": str(body.stat().st_size)}
            request = urllib.request.Request(url, data=data, method=method, headers=dict(headers))
            answer = opened.enter_context(urllib.request.urlopen(request, timeout=self._timeout))
            return bytes(answer.read())


class Job:
    """A job of the service: `state` is what the service said of it last."""

    def __init__(self, client: Client, state: Mapping[str, Any]) -> None:
        """Take what the service said."""
        self._client = client
        self.state = dict(state)

    @property
    def id(self) -> str:
        """Its id."""
        return str(self.state["id"])

    def __repr__(self) -> str:
        """Name the id and where it is."""
        return f"Job({self.id}, {self.state['state']})"

    def wait(self, progress: Progress = None, seconds: float | None = None) -> Job:
        """Wait for its end; raise `ServiceError` if it failed or was canceled, `TimeoutError` after `seconds`.

        `progress` is `True` for tqdm's bar, or called with the share that is done and the name of the phase.
        """
        return told(progress, lambda tell: self._wait(tell, seconds))

    def _wait(self, tell: Tell | None, seconds: float | None) -> Job:
        deadline = None if seconds is None else time.monotonic() + seconds
        while self.state["state"] in ("queued", "running"):
            left = _UNWATCHED_SECONDS if tell is None else _WATCHED_SECONDS
            if deadline is not None:
                left = min(left, deadline - time.monotonic())
                if left <= 0.0:
                    raise TimeoutError(f"job {self.id} is {self.state['state']} after {seconds} seconds")
            self.state = self._client._json("GET", f"/jobs/{self.id}", {"wait": max(1, round(left))})
            if tell is not None:
                tell(float(self.state["progress"]), self.state["phase"] or self.state["state"])
        if self.state["state"] != "succeeded":
            problem = self.state.get("error") or {"detail": f"job {self.id} was {self.state['state']}"}
            raise ServiceError(int(problem.get("status", 409)), problem)
        return self

    def spectrum(self) -> dict[str, Any]:
        """Eigenvalues, residuals, certificates and invariants."""
        return dict(json.loads(self._get("spectrum", {"format": "json"})))

    def bases(self, first: int = 0, count: int | None = None) -> Bases:
        """Points, eigenvalues, mass and bases as arrays: all bases, or `count` of them from `first` on."""
        body = self._get("bases", {"format": "npz", "first": first or None, "count": count})
        with np.load(io.BytesIO(body)) as arrays:
            return Bases(arrays["points"], arrays["eigenvalues"], arrays["mass"], arrays["bases"])

    def filtered(self, **arguments: Any) -> Array:
        """Filtered coordinates, n × d: `filter="low-pass", cutoff=16`, and whatever else the service takes."""
        array: Array = np.load(io.BytesIO(self._get("filtered", {"format": "npy", **arguments})))
        return array

    def image(self, basis: int, **view: Any) -> bytes:
        """Draw the cloud, colored by a basis, as PNG."""
        return self._get(f"bases/{basis}/image.png", view)

    def cancel(self) -> None:
        """Ask the job to end."""
        self._client.request("POST", f"/jobs/{self.id}/cancel")

    def _get(self, result: str, query: Mapping[str, Any]) -> bytes:
        return self._client.request("GET", f"/jobs/{self.id}/{result}", query)


def _argument(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(_argument(item) for item in value)
    return str(value)


def _retry_after(error: urllib.error.HTTPError) -> float:
    try:
        return min(60.0, max(0.1, float(error.headers.get("Retry-After", ""))))
    except ValueError:
        return 1.0


def _problem(error: urllib.error.HTTPError) -> dict[str, Any]:
    body = error.read()
    try:
        problem = json.loads(body)
    except ValueError:
        return {"detail": body.decode("utf-8", "replace")[:500]}
    return problem if isinstance(problem, dict) else {"detail": str(problem)}
