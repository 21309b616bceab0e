"""Seconds that chladni and the usual Python packages take to read the same files.

    cargo build --release --example read
    .ci/tool formats -r .ci/requirements.txt && target/tools/formats/bin/pip install pye57 open3d
    target/tools/formats/bin/python benches/reading.py [POINTS]

Every reader gets the best of five rounds; chladni reads from memory what the others read from the page cache. All give doubles.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np
from plyfile import PlyData, PlyElement

N = int(sys.argv[1]) if len(sys.argv) > 1 else 2_000_000
READ = Path(__file__).parent.parent / "target/release/examples/read"
random = np.random.default_rng(3)
points = np.round(random.uniform(-50, 50, size=(N, 3)), 3)
colors = random.integers(0, 256, size=(N, 3), dtype=np.uint8)


def plyfile(path):
    vertex = PlyData.read(path)["vertex"]
    columns = [vertex[c].astype(np.float64) for c in ("red", "green", "blue") if c in vertex]
    return [np.column_stack([vertex[a] for a in "xyz"]).astype(np.float64, copy=False), *columns]


def las(path):
    file = laspy.read(path)
    return [file.xyz, np.asarray(file.intensity), np.asarray(file.red), np.asarray(file.green), np.asarray(file.blue), np.asarray(file.gps_time)]


def numpy(path):
    return np.loadtxt(path, delimiter="," if path.suffix == ".csv" else None, skiprows=int(path.suffix == ".csv"))


def pcd(path):
    import pypcd4

    return pypcd4.PointCloud.from_path(path).numpy().astype(np.float64)


def e57(path):
    import pye57

    with pye57.E57(str(path)) as file:
        return file.read_scan_raw(0)


def open3d(path):
    import open3d as o3d

    return o3d.t.io.read_point_cloud(str(path))


def files(folder):
    """Files of the same points, and who else reads them."""
    vertex = np.zeros(N, dtype=[(a, "f8") for a in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")])
    single = np.zeros(N, dtype=[(a, "f4") for a in "xyz"])
    for i, axis in enumerate("xyz"):
        vertex[axis], single[axis] = points[:, i], points[:, i]
    for i, color in enumerate(("red", "green", "blue")):
        vertex[color] = colors[:, i]
    for name, rows, text in [("doubles.ply", vertex, False), ("floats.ply", single, False), ("text.ply", single, True)]:
        PlyData([PlyElement.describe(rows, "vertex")], text=text).write(folder / name)
        yield folder / name, [plyfile, open3d]
    np.savetxt(folder / "a.xyz", points, fmt="%.3f")
    yield folder / "a.xyz", [numpy, open3d]
    np.savetxt(folder / "a.csv", points, fmt="%.3f", delimiter=",", header="x,y,z", comments="")
    yield folder / "a.csv", [numpy]
    for name in ("a.las", "a.laz"):
        header = laspy.LasHeader(version="1.4", point_format=7)
        header.scales = [0.001] * 3
        file = laspy.LasData(header)
        file.xyz, file.intensity = points, colors[:, 0].astype(np.uint16)
        file.red, file.green, file.blue = (colors.T.astype(np.uint16) * 256)
        file.gps_time = np.arange(N) * 1e-5
        file.write(folder / name)
        yield folder / name, [las]
    try:
        import pypcd4

        cloud = pypcd4.PointCloud.from_points(points.astype(np.float32), ("x", "y", "z"), (np.float32,) * 3)
        cloud.save(folder / "a.pcd", pypcd4.Encoding.BINARY)
        yield folder / "a.pcd", [pcd, open3d]
    except ImportError:
        pass
    try:
        import pye57

        with pye57.E57(str(folder / "a.e57"), mode="w") as file:
            data = {f"cartesian{a}": np.ascontiguousarray(points[:, i]) for i, a in enumerate("XYZ")}
            file.write_scan_raw({**data, **{f"color{c}": colors[:, i] for i, c in enumerate(("Red", "Green", "Blue"))}})
        yield folder / "a.e57", [e57]
    except ImportError:
        pass


def best(read, path):
    seconds = []
    for _ in range(5):
        began = time.perf_counter()
        read(path)
        seconds.append(time.perf_counter() - began)
    return min(seconds)


with tempfile.TemporaryDirectory() as folder:
    print("file\tMB\tchladni s\tMB/s\tothers")
    for path, others in files(Path(folder)):
        told = subprocess.run([READ, path], check=True, capture_output=True, text=True).stdout.split("\t")
        megabytes, ours = path.stat().st_size / 1e6, float(told[3].split()[0])
        theirs = []
        for other in others:
            try:
                seconds = best(other, path)
                theirs.append(f"{other.__name__} {seconds:.3f} s, {megabytes / seconds:.0f} MB/s")
            except ImportError:
                theirs.append(f"{other.__name__} is not installed")
        print(f"{path.name}\t{megabytes:.0f}\t{ours:.3f}\t{megabytes / ours:.0f}\t{'; '.join(theirs)}", flush=True)
        path.unlink()
