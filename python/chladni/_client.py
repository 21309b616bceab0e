"""A client for the service: the standard library and NumPy only."""

from __future__ import annotations

import io
import json
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

Progress = Union[bool, Callable[[float, str], object], None]

# Answers that say "later": too many requests, no room at the moment.
_LATER = (429, 503)


class ServiceError(Exception):
    """An answer that is an error: `status`, `detail`, and the whole problem (RFC 9457)."""

    def __init__(self, status: int, problem: Mapping[str, Any]) -> None:
        """Take the status and the body of the answer."""
        super().__init__(f"{status}: {problem.get('detail') or problem.get('title') or 'no explanation'}")
        self.status = status
        self.problem = dict(problem)


class Bases(NamedTuple):
    """Bases as the service hands them out: `_, evals, _, evecs = bases`, or by name."""

    points: NDArray[np.float64]
    eigenvalues: NDArray[np.float64]
    mass: NDArray[np.float64]
    vectors: NDArray[np.float64]


class Client:
    """A service at a URL, with a key where it asks for one.

    An answer of 429 or 503 is waited out as its `Retry-After` says, at most `retry_seconds` in all. Submissions carry an
    idempotency key, so that one that is sent again is not stored twice.
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
        self, cloud: str | PathLike[str] | ArrayLike, format: str | None = None, **parameters: Any
    ) -> Job:
        """Upload a file, or an n × d array, and queue an analysis of it with the service's parameters."""
        if isinstance(cloud, (str, PathLike)):
            path = Path(cloud)
            body, format = path.read_bytes(), format or path.suffix.lstrip(".") or None
        else:
            buffer = io.BytesIO()
            np.save(buffer, np.ascontiguousarray(cloud, dtype=np.float64))
            body, format = buffer.getvalue(), "npy"
        headers = {"Idempotency-Key": str(uuid.uuid4()), "Content-Type": "application/octet-stream"}
        answer = self._json("POST", "/clouds", {"format": format, **parameters}, body, headers)
        return Job(self, answer["job"])

    def job(self, id: str) -> Job:
        """Find a job by its id."""
        return Job(self, self._json("GET", f"/jobs/{id}"))

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
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        return json.loads(self.request(method, path, query, body, headers))

    def request(
        self,
        method: str,
        path: str,
        query: Mapping[str, Any] | None = None,
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> bytes:
        """Send a request and give the body of the answer; errors raise `ServiceError`."""
        given = {name: _argument(value) for name, value in (query or {}).items() if value is not None}
        url = self.url + path + ("?" + urllib.parse.urlencode(given) if given else "")
        request = urllib.request.Request(url, data=body, method=method, headers=dict(headers or {}))
        if self._key is not None:
            request.add_header("Authorization", f"Bearer {self._key}")
        deadline = time.monotonic() + self._retry_seconds
        while True:
            try:
                with urllib.request.urlopen(request, timeout=self._timeout) as answer:
                    return bytes(answer.read())
            except urllib.error.HTTPError as error:
                pause = _retry_after(error)
                if error.code not in _LATER or time.monotonic() + pause > deadline:
                    raise ServiceError(error.code, _problem(error)) from None
            time.sleep(pause)


class Job:
    """A job of the service."""

    def __init__(self, client: Client, state: Mapping[str, Any]) -> None:
        """Take what the service said of it last."""
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
        """Wait for its end; raise `ServiceError` if it failed, `TimeoutError` after so many seconds.

        `progress` is `True` for tqdm's bar, or called with the share that is done and the name of the phase.
        """
        if progress is True:
            from tqdm.auto import tqdm

            with tqdm(total=100, unit="%", bar_format="{desc:>14} {percentage:3.0f}% |{bar}| {elapsed}") as bar:

                def told(share: float, phase: str) -> None:
                    bar.set_description(phase)
                    bar.update(100.0 * share - bar.n)

                return self.wait(told, seconds)
        deadline = None if seconds is None else time.monotonic() + seconds
        while self.state["state"] in ("queued", "running"):
            left = 1.0 if callable(progress) else 30.0
            if deadline is not None:
                left = min(left, deadline - time.monotonic())
                if left <= 0.0:
                    raise TimeoutError(f"job {self.id} is {self.state['state']} after {seconds} seconds")
            self.state = self._client._json("GET", f"/jobs/{self.id}", {"wait": max(1, round(left))})
            if callable(progress):
                progress(float(self.state["progress"]), self.state["phase"] or self.state["state"])
        if self.state["state"] != "succeeded":
            problem = self.state.get("error") or {"detail": f"job {self.id} was {self.state['state']}"}
            raise ServiceError(int(problem.get("status", 409)), problem)
        return self

    def spectrum(self) -> dict[str, Any]:
        """Eigenvalues, residuals, certificates and invariants."""
        return dict(json.loads(self._get("spectrum", {"format": "json"})))

    def bases(self, first: int = 0, count: int | None = None) -> Bases:
        """Points, eigenvalues, mass and bases as arrays."""
        body = self._get("bases", {"format": "npz", "first": first or None, "count": count})
        with np.load(io.BytesIO(body)) as arrays:
            return Bases(arrays["points"], arrays["eigenvalues"], arrays["mass"], arrays["bases"])

    def filtered(self, **arguments: Any) -> NDArray[np.float64]:
        """Filtered coordinates, n × d: `filter="low-pass", cutoff=16`, and whatever else the service takes."""
        array: NDArray[np.float64] = np.load(io.BytesIO(self._get("filtered", {"format": "npy", **arguments})))
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
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
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
