"""Files of other programs are read by chladni, and its files by them. Called as: python formats.py CHLADNI"""

import contextlib
import json
import struct
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

import numpy as np

CHLADNI = str(Path(sys.argv[1]).resolve())
rng = np.random.default_rng(7)
# A georeferenced sphere on a grid of millimeters.
points = rng.normal(size=(500, 3))
points = np.round(points / np.linalg.norm(points, axis=1)[:, None], 3) + [500000.0, 5200000.0, 100.0]
colors = rng.integers(0, 256, size=(500, 3), dtype=np.uint8)
intensity = rng.integers(0, 65536, size=500, dtype=np.uint16)


# Brings the turned second scan beside the first: together they are no line.
BESIDE = [5700000.0, 4700000.0, 3.0]


def convert(source, *arguments):
    """What chladni reads in a file, as an array."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [CHLADNI, "analyze", str(source), "-o", str(out), "--operator", "graph", "-k", "1", *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{source.name}: {done.stderr}")
        from plyfile import PlyData

        vertex = PlyData.read(out / "bases.ply")["vertex"]
        fields = {p.name.removeprefix("scalar_"): np.asarray(vertex[p.name]) for p in vertex.properties}
        return np.column_stack([fields.pop(a) for a in "xyz"]), fields


def rewritten(source, folder, extension):
    """What chladni writes of a file in another format: the filter that changes nothing."""
    out = folder / f"{source.name}-{extension}"
    analyze = [CHLADNI, "analyze", str(source), "-o", str(out), "--operator", "graph", "-k", "1"]
    subprocess.run(analyze, check=True, capture_output=True)
    path = folder / f"{source.name}.out.{extension}"
    identity = [CHLADNI, "filter", str(out), "-o", str(path), "--gains", "1", "--outside", "1"]
    done = subprocess.run(identity, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{path.name}: {done.stderr}")
    return path


@contextlib.contextmanager
def service(folder):
    """A running service; gives a function that stores a file and answers what it is in another format."""
    flags = ["--listen", "127.0.0.1:0", "--disk-floor", "0", "--database", str(folder / "service.db")]
    process = subprocess.Popen([CHLADNI, "serve", *flags], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        address = next(word for word in process.stdout.readline().split() if word.startswith("http://"))

        def exchanged(path, format):
            sent = urllib.request.Request(
                f"{address}/clouds/{path.name}?analyze=false", data=path.read_bytes(), method="PUT"
            )
            with urllib.request.urlopen(sent) as answer:
                points = json.load(answer)["links"]["points"]
            with urllib.request.urlopen(f"{address}{points}?format={format}") as answer:
                return answer.read()

        yield exchanged
    finally:
        process.terminate()
        process.wait()


def projected(header, fmt):
    """A coordinate system as the point format wants it: well-known text from 6 on, keys of GeoTIFF before."""
    if fmt >= 6:
        header.global_encoding.wkt = True
        return laspy_record("LASF_Projection", 2112, b'PROJCS["ETRS89 / UTM zone 32N",AUTHORITY["EPSG","25832"]]\0')
    return laspy_record("LASF_Projection", 34735, struct.pack("<8H", 1, 1, 0, 1, 3072, 0, 1, 25832))


def laspy_record(user, number, data):
    from laspy.vlrs.vlr import VLR

    return VLR(user_id=user, record_id=number, description="by laspy", record_data=data)


def check(name, found, expected, tolerance):
    error = np.abs(np.asarray(found, dtype=float) - np.asarray(expected, dtype=float)).max()
    print(f"{name}: largest difference {error:.1e}")
    if not error <= tolerance:
        sys.exit(f"{name}: {error} > {tolerance}")


def same(name, found, expected):
    if found != expected:
        sys.exit(f"{name}: not the same")
    print(f"{name}: the same")


def read_by_chladni(folder, exchanged):
    import laspy
    import pypcd4
    import trimesh
    from plyfile import PlyData, PlyElement

    rows = np.zeros(500, dtype=[("x", "f8"), ("y", "f8"), ("z", "f8"), ("red", "u1"), ("intensity", "u2")])
    rows["x"], rows["y"], rows["z"] = points.T
    rows["red"], rows["intensity"] = colors[:, 0], intensity
    for text in (False, True):
        path = folder / f"plyfile-{text}.ply"
        PlyData([PlyElement.describe(rows, "vertex")], text=text).write(path)
        found, fields = convert(path)
        check(path.name, found, points, 0)
        check(path.name + " intensity", fields["intensity"], intensity, 0)

    for name, version, fmt in [("a.las", "1.2", 3), ("b.las", "1.4", 7), ("c.laz", "1.2", 2), ("d.laz", "1.4", 8)]:
        header = laspy.LasHeader(version=version, point_format=fmt)
        header.scales, header.offsets = [0.001] * 3, [500000, 5200000, 0]
        header.add_extra_dim(laspy.ExtraBytesParams(name="quality", type=np.float32))
        las = laspy.LasData(header)
        las.x, las.y, las.z = points.T
        las.intensity, las.red = intensity, colors[:, 0].astype(np.uint16) * 257
        las.quality = points[:, 2].astype(np.float32)
        las.write(folder / name)
        found, fields = convert(folder / name)
        check(f"laspy {name} ({version}, format {fmt})", found, np.column_stack([las.x, las.y, las.z]), 0)
        check(f"laspy {name} intensity", fields["intensity"], intensity, 0)
        check(f"laspy {name} red", fields["red"], las.red, 0)
        check(f"laspy {name} extra bytes", fields["quality"], las.quality, 0)

    flags = ["synthetic", "key_point", "withheld", "scan_direction_flag", "edge_of_flight_line"]
    for fmt in range(11):
        header = laspy.LasHeader(version="1.4", point_format=fmt)
        header.scales, header.offsets = [0.001] * 3, [500000, 5200000, 0]
        header.add_extra_dim(laspy.ExtraBytesParams(name="vec", type="3u1"))
        header.add_extra_dim(laspy.ExtraBytesParams(name="behind", type=np.int16))
        record = projected(header, fmt)
        header.vlrs.append(record)
        las = laspy.LasData(header)
        las.x, las.y, las.z = points.T
        present = flags + (["overlap", "scanner_channel"] if fmt >= 6 else [])
        for flag in present:
            las[flag] = rng.integers(0, 4 if flag == "scanner_channel" else 2, size=500, dtype=np.uint8)
        las.vec = rng.integers(0, 256, size=(500, 3), dtype=np.uint8)
        las.behind = rng.integers(-9, 9, size=500, dtype=np.int16)
        path = folder / f"flags{fmt}.las"
        las.write(path)
        _, fields = convert(path)
        for flag in present:
            check(f"laspy format {fmt} {flag}", fields[flag], las[flag], 0)
        check(f"laspy format {fmt} array", np.column_stack([fields[f"vec_{i}"] for i in range(3)]), las.vec, 0)
        check(f"laspy format {fmt} behind the array", fields["behind"], las.behind, 0)
        same(f"laspy format {fmt}, byte for byte", exchanged(path, "las"), path.read_bytes())
        if fmt in (3, 6):
            back = laspy.read(rewritten(path, folder, "laz"))
            found = [vlr.record_data_bytes() for vlr in back.header.vlrs if vlr.record_id == record.record_id]
            same(f"laspy reads the coordinate system of format {fmt} back", found, [record.record_data_bytes()])
            check(f"laspy reads format {fmt} back", np.column_stack([back.x, back.y, back.z]), points, 2e-9)
            for flag in present:
                check(f"laspy reads {flag} back", back[flag], las[flag], 0)

    near = (points - [500000.0, 5200000.0, 100.0]).astype(np.float32)
    packed = pypcd4.PointCloud.encode_rgb(colors)
    cloud = pypcd4.PointCloud.from_xyzrgb_points(np.column_stack([near, packed]).astype(np.float32))
    for encoding in (pypcd4.Encoding.ASCII, pypcd4.Encoding.BINARY, pypcd4.Encoding.BINARY_COMPRESSED):
        path = folder / f"pypcd4-{encoding.value}.pcd"
        cloud.save(path, encoding)
        found, fields = convert(path)
        check(path.name, found, near, 1e-9)
        # pypcd4 writes ten decimals, of which nothing is left of a color packed into a float.
        for i, name in enumerate(() if encoding == pypcd4.Encoding.ASCII else ("red", "green", "blue")):
            check(f"{path.name} {name}", fields[name], colors[:, i], 0)

    mesh = trimesh.creation.icosphere(subdivisions=2)
    for extension, kind in [("stl", "stl"), ("stl", "stl_ascii"), ("off", "off"), ("obj", "obj"), ("ply", "ply")]:
        path = folder / f"trimesh-{kind}.{extension}"
        path.write_bytes(data if isinstance(data := mesh.export(file_type=kind), bytes) else data.encode())
        found, _ = convert(path)
        # The rows of an STL file are in the order of its triangles.
        order = lambda a: a[np.lexsort(np.round(a, 5).T)]
        check(path.name, order(found), order(np.asarray(mesh.vertices)), 1e-6)

    import meshio

    triangles = [("triangle", np.asarray(mesh.faces))]
    for extension in ("ply", "off", "obj", "stl"):
        path = folder / f"meshio.{extension}"
        meshio.write_points_cells(path, np.asarray(mesh.vertices), triangles)
        found, _ = convert(path)
        order = lambda a: a[np.lexsort(np.round(a, 5).T)]
        check(f"meshio {extension}", order(found), order(np.asarray(mesh.vertices)), 1e-6)

    np.savez_compressed(folder / "a.npz", xyz=points, intensity=intensity)
    found, fields = convert(folder / "a.npz")
    check("numpy.savez_compressed", found, points, 0)
    check("numpy.savez_compressed intensity", fields["intensity"], intensity, 0)
    records = np.zeros(500, dtype=[("id", "<u4"), ("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
    records["x"], records["y"], records["z"] = points.T
    np.save(folder / "records.npy", records)
    check("numpy records", convert(folder / "records.npy")[0], points, 0)

    np.save(folder / "a.npy", np.asfortranarray(points))
    check("numpy.save", convert(folder / "a.npy")[0], points, 0)
    np.savetxt(folder / "a.txt", points, delimiter=",", header="x,y,z", comments="")
    check("numpy.savetxt", convert(folder / "a.txt")[0], points, 0)

    try:
        import pye57
    except ImportError:
        print("pye57 is not installed: only the tests of the crate cover E57")
        return
    path = str(folder / "a.e57")
    with pye57.E57(path, mode="w") as file:
        data = {f"cartesian{a}": np.ascontiguousarray(points[:, i]) for i, a in enumerate("XYZ")}
        data["intensity"] = intensity.astype(np.float32)
        file.write_scan_raw(data)
        data["cartesianX"] = data["cartesianX"] + 1
        file.write_scan_raw(data, rotation=np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), translation=np.array(BESIDE))
    found, fields = convert(Path(path), "--scan", "0")
    with pye57.E57(path) as file:
        # pye57 writes single precision: what it reads back is compared.
        first, second = (file.read_scan_raw(scan) for scan in (0, 1))
    kept = lambda scan: np.column_stack([scan[f"cartesian{a}"] for a in "XYZ"])
    check("pye57, first scan", found, kept(first), 0)
    check("pye57, intensity", fields["intensity"], intensity, 0)
    moved = kept(second)
    turned = np.column_stack([-moved[:, 1], moved[:, 0], moved[:, 2]]) + BESIDE
    check("pye57, second scan in its pose", convert(Path(path), "--scan", "1")[0], turned, 2e-9)
    both, fields = convert(Path(path))
    check("pye57, all scans", both, np.vstack([kept(first), turned]), 2e-9)
    check("pye57, the field of scans", fields["scan"], np.repeat([0, 1], 500), 0)


def sample(folder, name, *arguments):
    command = [CHLADNI, "sample", "sphere", "-n", "500", "-o", name, *arguments]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / name


def written_by_chladni(folder):
    import laspy
    import meshio
    import pypcd4
    import trimesh
    from plyfile import PlyData

    expected = np.load(sample(folder, "s.npy"))
    for extension in ("las", "laz"):
        las = laspy.read(sample(folder, f"s.{extension}"))
        check(f"laspy reads {extension}", np.column_stack([las.x, las.y, las.z]), expected, 1e-9)
    vertex = PlyData.read(sample(folder, "s.ply"))["vertex"]
    check("plyfile reads ply", np.column_stack([vertex[a] for a in "xyz"]), expected, 0)
    cloud = trimesh.load(sample(folder, "s.ply"))
    check("trimesh reads ply", cloud.vertices, expected, 0)
    check("numpy reads xyz", np.loadtxt(sample(folder, "s.xyz")), expected, 0)
    check("numpy reads csv", np.loadtxt(sample(folder, "s.csv"), delimiter=",", skiprows=1), expected, 0)
    cloud = pypcd4.PointCloud.from_path(sample(folder, "s.pcd"))
    check("pypcd4 reads pcd", cloud.numpy(("x", "y", "z")), expected, 0)
    for extension in ("obj", "off", "stl"):
        grid = np.load(sample(folder, "g.npy", "--sampling", "grid"))
        found = meshio.read(sample(folder, f"g.{extension}", "--sampling", "grid")).points
        order = lambda a: a[np.lexsort(np.round(a, 4).T)]
        distinct = np.unique(np.round(grid, 6), axis=0)
        check(f"meshio reads {extension}", np.unique(np.round(found, 6), axis=0)[: len(distinct)], distinct, 1e-5)
    for extension in ("obj", "off"):
        mesh = trimesh.load(sample(folder, f"g.{extension}", "--sampling", "grid"), process=False)
        grid = np.load(sample(folder, "g.npy", "--sampling", "grid"))
        check(f"trimesh reads {extension}", mesh.vertices, grid, 1e-8)
        if len(mesh.faces) == 0:
            sys.exit(f"trimesh finds no faces in {extension}")


def open3d_both_ways(folder):
    try:
        import open3d
    except ImportError:
        print("open3d is not installed: PLY, PCD, XYZ, OBJ, OFF and STL are read by the others only")
        return
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.colors = open3d.utility.Vector3dVector(colors / 255.0)
    for name, ascii in [("b.ply", False), ("t.ply", True), ("b.pcd", False), ("t.pcd", True), ("c.xyz", False), ("c.pts", False)]:
        path = folder / f"open3d-{name}"
        if not open3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii):
            sys.exit(f"open3d does not write {name}")
        # open3d writes PCD in single precision, the text of PLY in six digits, other text in ten decimals.
        tolerance = 0.25 if name == "b.pcd" else 1e-9 if path.suffix != ".pcd" else 1e-3
        written = np.vectorize(lambda x: float(f"{x:g}"))(points) if name == "t.ply" else points
        found, fields = convert(path)
        check(path.name, found, written, tolerance)
        if path.suffix == ".ply":
            check(f"{path.name} red", fields["red"], colors[:, 0], 0)
    sphere = open3d.geometry.TriangleMesh.create_sphere(resolution=9)
    sphere.compute_triangle_normals()
    for extension in ("ply", "obj", "off", "stl"):
        path = folder / f"open3d-mesh.{extension}"
        open3d.io.write_triangle_mesh(str(path), sphere)
        found, _ = convert(path)
        check(path.name, np.unique(np.round(found, 5), axis=0), np.unique(np.round(np.asarray(sphere.vertices), 5), axis=0), 1e-5)

    expected = np.load(sample(folder, "o.npy"))
    # Not PCD: open3d takes coordinates of eight bytes for zeros.
    for extension in ("ply", "xyz"):
        found = open3d.io.read_point_cloud(str(sample(folder, f"o.{extension}")))
        check(f"open3d reads {extension}", np.asarray(found.points), expected, 0)
    grid = np.load(sample(folder, "og.npy", "--sampling", "grid"))
    for extension in ("ply", "obj", "off", "stl"):
        found = open3d.io.read_triangle_mesh(str(sample(folder, f"og.{extension}", "--sampling", "grid")))
        if len(found.triangles) == 0:
            sys.exit(f"open3d finds no triangles in {extension}")
        distinct = np.unique(np.round(np.asarray(found.vertices), 6), axis=0)
        check(f"open3d reads the mesh in {extension}", distinct, np.unique(np.round(grid, 6), axis=0), 1e-5)


with tempfile.TemporaryDirectory() as folder, service(Path(folder)) as exchanged:
    read_by_chladni(Path(folder), exchanged)
    written_by_chladni(Path(folder))
    open3d_both_ways(Path(folder))
