#!/usr/bin/env python3
"""Reads the ParaView files of a case with VTK and compares them with its snapshots.

    python3 tests/vtk_readback.py CASE

For each step that CASE/DISPLAY/grains.pvd names, or that grains.vtkhdf contains, every array is compared with
the value that numpy computes from CASE/OUTBOX/snapshot-NNNNNN.npz: arrays of the snapshot bit for
bit, sums within round-off. Prints the number of states and faults; exits 1 if anything differs. Needs vtk and numpy.
"""

import json
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPPolyDataReader

NO_CONTACT = 0
DRIVEN_ALL, PLANE, POLYHEDRON = 63, 1, 2
ROUNDING = 1e-13  # of the largest sum of absolute terms: a few hundred roundings

faults = []


def check(where, found, expected, scale=None):
    """Fails unless `found` is exactly `expected`, or within round-off of `scale`, the sums of the absolute terms."""
    found, expected = np.asarray(found), np.asarray(expected)
    if found.shape != expected.shape:
        faults.append(f"{where}: shape {found.shape}, expected {expected.shape}")
    elif scale is None and not np.array_equal(found, expected):
        worst = np.flatnonzero((found != expected).reshape(len(found), -1).any(axis=1))[0]
        faults.append(f"{where}: row {worst} is {found[worst]}, expected {expected[worst]}")
    elif scale is not None and found.size:
        error, bound = np.abs(found - expected).max(), ROUNDING * np.max(scale)
        if not error <= bound:
            faults.append(f"{where}: differs by {error:.3e}, more than {bound:.3e}")


class DisplayData:
    """The data of one kind at one time: a .vtp file, a .pvtp file with its pieces, or a time of a .vtkhdf file."""

    def __init__(self, path, time, snapshot):
        self.path, self.time, self.snapshot = path, time, snapshot
        self.name = path.name if path.suffix != ".vtkhdf" else f"{path.name} at {time} s"
        self.parent = path.parent

    def output(self):
        if self.path.suffix == ".vtp":
            return read(vtkXMLPolyDataReader(), self.path)
        if self.path.suffix == ".pvtp":
            return read(vtkXMLPPolyDataReader(), self.path)
        return read(vtkHDFReader(), self.path, self.time)


def read(reader, path, time=None):
    """Output of a reader of VTK; its errors are faults."""
    for speaker in (reader, reader.GetExecutive()):
        speaker.AddObserver("ErrorEvent", lambda *_: faults.append(f"{path}: VTK cannot read it"))
    reader.SetFileName(str(path))
    reader.Update() if time is None else reader.UpdateTimeStep(time)
    return reader.GetOutput()


def collection(display, kind):
    """The data of one kind at all times, in the format that is there; None if there are none."""
    outbox = display.parent / "OUTBOX"
    pvd, hdf = display / f"{kind}.pvd", display / f"{kind}.vtkhdf"
    if pvd.exists():
        sets = ElementTree.parse(pvd).getroot().iter("DataSet")
        paths = [(float(s.get("timestep")), display / s.get("file")) for s in sets]
        return [DisplayData(path, time, outbox / f"snapshot-{path.stem.split('-')[1]}.npz") for time, path in paths]
    if hdf.exists():
        reader = vtkHDFReader()
        read(reader, hdf)
        times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()) or ()
        snapshots = sorted(outbox.glob("snapshot-*.npz"))
        check(f"{hdf.name} number of times", [len(times)], [len(snapshots)])
        return [DisplayData(hdf, time, snapshot) for time, snapshot in zip(times, snapshots)]
    return None


class Polydata:
    """Data of ParaView files as numpy arrays."""

    def __init__(self, file):
        data = self.data = file.output()
        points = data.GetPoints()
        self.points = vtk_to_numpy(points.GetData()) if points and points.GetNumberOfPoints() else np.zeros((0, 3))
        self.point, self.cell = (
            {a.GetArrayName(k): vtk_to_numpy(a.GetArray(k)) for k in range(a.GetNumberOfArrays())}
            for a in (data.GetPointData(), data.GetCellData())
        )

    def polygons(self):
        """Point numbers of each polygon."""
        cells = self.data.GetPolys()
        ends = vtk_to_numpy(cells.GetOffsetsArray())
        return np.split(vtk_to_numpy(cells.GetConnectivityArray()), ends[1:-1]) if cells.GetNumberOfCells() else []

    def cells(self, kind, size):
        """Point numbers of the cells of one kind, all of `size` points."""
        cells = getattr(self.data, f"Get{kind}")()
        if cells.GetNumberOfCells() == 0:
            return np.zeros((0, size), int)
        return vtk_to_numpy(cells.GetConnectivityArray()).reshape(-1, size)


def rotation(q):
    """Matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def polyhedra(path):
    """The vertices of the polyhedra of each body in BODIES.DAT, one array for all its contactors."""
    vertices, number = {}, 0
    for line in path.read_text().splitlines():
        if line.startswith("$bdyty"):
            number += 1
        elif line[1:6] == "POLYR":
            left = int(line[39:47])
            vertices.setdefault(number, [])
        elif number in vertices and left and "coo1=" in line:
            vertices[number].append([float(line[k:k + 14].replace("D", "E")) for k in (34, 55, 76)])
            left -= 1
    return {number: np.array(rows) for number, rows in vertices.items()}


# Indices of the static friction, of the attraction, N, and of its range, m, in the parameters of a law of each kind.
PARAMETER_INDICES = {
    "IQS_CLB": (0, None, None),
    "IQS_DS_CLB": (1, None, None),
    "RST_CLB": (2, None, None),
    "IQS_WET_DS_CLB": (4, 0, 2),
}


def friction_attraction_and_range(law):
    return [0.0 if index is None else law["parameters"][index] for index in PARAMETER_INDICES[law["kind"]]]


class Snapshot:
    """The arrays of a snapshot, bodies split into grains and walls as cd-post does."""

    def __init__(self, path):
        self.all = {name: array for name, array in np.load(path).items()}
        self.meta = json.loads(self.all.pop("meta").tobytes())
        bodies = path.parent.parent / "DATBOX" / "BODIES.DAT"
        counts = [body.count(" POLYR ") for body in bodies.read_text().split("$bdyty")]
        self.single = [count == 1 for count in counts]  # by number of the body
        self.wall = (self["body_driven"] == DRIVEN_ALL) | (self["body_shape"] == PLANE)
        self.rows = np.flatnonzero(~self.wall)  # row of each grain
        self.number = np.full(len(self.wall), -1)
        self.number[self.rows] = np.arange(len(self.rows))  # grain of each row
        drawn = ~self.wall[self["contact_body"]].all(axis=1)  # contacts between walls are not
        for name in list(self.all):
            if name.startswith("contact_"):
                self.all[name] = self.all[name][drawn]
        self.force = np.einsum("ki,kij->kj", self["contact_force"], self["contact_frame"])
        # In a periodic scene grains are drawn in the cell about the origin, and touch the nearest image of another.
        self.periods = np.array([self.meta["parameters"].get(name) or np.inf for name in ("xperiode", "yperiode")] + [np.inf])
        x = self["body_x"]
        moved = np.where(self.wall[:, None], 0.0, -self.whole(x))
        self.all["body_x"] = x + moved
        half_way = x + moved - self.meta["parameters"]["theta"] * self.meta["h"] * np.where(self.wall[:, None], 0.0, self["body_v"])
        candidate, antagonist = self["contact_body"].T
        self.image = self.whole(half_way[candidate] - half_way[antagonist])
        self.all["contact_point"] = self["contact_point"] + moved[candidate]
        self.active = (self["contact_impulse"] != 0).any(axis=1)
        # A contact with force that is open only pulls at a distance.
        self.touching = self.active & (self["contact_status"] != NO_CONTACT)
        laws = [friction_attraction_and_range(law) for law in self.meta["laws"]]
        self.friction, attraction, reach = np.array(laws).reshape(-1, 3)[self["contact_law"]].T
        self.attraction = np.where(self["contact_gap"] <= reach, attraction, 0.0)  # a liquid pulls no farther

    def __getitem__(self, name):
        return self.all[name]

    def whole(self, d):
        """Whole numbers of periods, m, that are nearest to the vectors `d`."""
        turns = np.floor(np.abs(d) / self.periods + 0.5) * np.sign(d)
        return np.where(np.isinf(self.periods), 0.0, turns * np.where(np.isinf(self.periods), 0.0, self.periods))

    def grain(self, name):
        return self["body_" + name][self.rows]


def check_grains(path, snapshot):
    file, s = Polydata(path), snapshot
    check(f"{path.name} points", file.points, s.grain("x"))
    check(f"{path.name} vertices", file.cells("Verts", 1)[:, 0], np.arange(len(s.rows)))
    check_arrays(path, s, file.point, np.arange(len(s.rows)))


def check_polyhedra(path, snapshot):
    """Vertices from BODIES.DAT where the snapshot has their bodies; closed surfaces around the bodies' volumes."""
    file, s = Polydata(path), snapshot
    solids = polyhedra(path.parent.parent / "DATBOX" / "BODIES.DAT")
    grains = np.flatnonzero(s.grain("shape") == POLYHEDRON)
    placed = [s.grain("x")[k] + solids[s.grain("id")[k]] @ rotation(s.grain("q")[k]).T for k in grains]
    # The digits of BODIES.DAT, in which the vertices are centred.
    scale = 1e4 * max(np.abs(p).max() for p in placed)
    check(f"{path.name} points", file.points, np.concatenate(placed), scale)
    ends = np.cumsum([len(p) for p in placed])
    owner, volume = [], np.zeros(len(grains))
    for polygon in file.polygons():
        k = np.searchsorted(ends, polygon[0], side="right")
        corners = file.points[polygon] - s.grain("x")[grains[k]]
        for a, b in zip(corners[1:-1], corners[2:]):
            volume[k] += np.dot(corners[0], np.cross(a, b)) / 6
        owner.append(k)
    single = np.array([1.0 if s.single[s.grain("id")[grains[k]]] else 0.0 for k in range(len(grains))])
    expected = 4 / 3 * np.pi * s.grain("radius")[grains] ** 3
    check(f"{path.name} volumes", volume * single, expected * single, 1e6 * expected)
    check_arrays(path, s, file.cell, grains[owner])


def check_arrays(path, s, found, rows):
    """Compares the arrays `found` with the values of the grains `rows`, a row for each."""
    count = len(s.rows)
    find = lambda name: found.get(name, [])
    exact = {
        "radius": "radius", "id": "id", "velocity": "v", "spin": "w_world", "material": "material", "colour": "colour",
        "mass": "mass",
    }
    for name, array in exact.items():
        check(f"{path.name} {name}", find(name), s.grain(array)[rows])

    contacts, stress, scale = np.zeros(count, int), np.zeros((count, 3, 3)), np.zeros(count)
    half_way = s.grain("x") - s.meta["parameters"]["theta"] * s.meta["h"] * s.grain("v")
    volume = 4 / 3 * np.pi * s.grain("radius") ** 3
    for side, sign in ((0, 1.0), (1, -1.0)):
        grains = s.number[s["contact_body"][:, side]]
        for k in np.flatnonzero((grains >= 0) & s.active):
            i, arm = grains[k], half_way[grains[k]] + side * s.image[k] - s["contact_point"][k]
            contacts[i] += s.touching[k]
            stress[i] += sign * np.outer(s.force[k], arm) / volume[i]
            scale[i] += np.linalg.norm(s.force[k]) * np.linalg.norm(arm) / volume[i]
    check(f"{path.name} contacts", find("contacts"), contacts[rows])
    check(f"{path.name} stress", find("stress"), stress.reshape(count, 9)[rows], scale)
    check(f"{path.name} pressure", find("pressure"), np.trace(stress, axis1=1, axis2=2)[rows] / 3, scale)
    pairs = {tuple(sorted(pair)) for pair in s["contact_body"][s.touching]}
    neighbours = np.array([sum(row in pair for pair in pairs) for row in s.rows], int).reshape(count)
    check(f"{path.name} neighbours", find("neighbours"), neighbours[rows])
    # Grains that touch with force are in one fragment, and heavier fragments have lower numbers.
    fragment = np.full(count, -1)
    fragment[rows] = find("fragment")
    drawn = set(rows)
    for a, b in pairs:
        a, b = s.number[a], s.number[b]
        if a in drawn and b in drawn and fragment[a] != fragment[b]:
            faults.append(f"{path.name} fragment: grains {a} and {b} touch, but are in {fragment[a]} and {fragment[b]}")
    if len(drawn) == count:
        masses = np.bincount(fragment, s.grain("mass")) if count else np.zeros(0)
        check(f"{path.name} fragment", masses, np.sort(masses)[::-1])
    check(f"{path.name} polyhedron", find("polyhedron"), (s.grain("shape") == POLYHEDRON)[rows])
    turns = find("orientation")
    check(f"{path.name} orientation", turns, s.grain("q")[rows], np.ones(1))

    # Angular velocity to the body's frame, where the inertia is diagonal.
    spin = np.array([rotation(q).T @ w for q, w in zip(s.grain("q"), s.grain("w_world"))]).reshape(count, 3)
    energy = 0.5 * (s.grain("mass") * (s.grain("v") ** 2).sum(1) + (s.grain("inertia") * spin**2).sum(1))
    check(f"{path.name} kinetic_energy", find("kinetic_energy"), energy[rows], energy)
    relative = s.grain("v") - s.grain("mass") @ s.grain("v") / s.grain("mass").sum() if count else s.grain("v")
    motion = np.einsum("i,ij,ik->ijk", s.grain("mass") / volume, relative, relative).reshape(count, 9)
    largest_motion = s.grain("mass") / volume * (s.grain("v") ** 2).sum(1)
    check(f"{path.name} kinetic_stress", find("kinetic_stress"), motion[rows], largest_motion)
    sums = {"contacts", "stress", "pressure", "kinetic_energy", "kinetic_stress", "neighbours", "fragment", "orientation", "polyhedron"}
    unknown = set(found) - set(exact) - sums
    if unknown:
        faults.append(f"{path.name}: arrays that are not checked: {sorted(unknown)}")


def check_contacts(path, snapshot):
    file, s = Polydata(path), snapshot
    # The ends of a line: the centre of a grain, or of its image; the point of contact on a wall.
    ends = file.points[file.cells("Lines", 2)]
    on_wall = s.wall[s["contact_body"]][:, :, None]
    centres = s["body_x"][s["contact_body"]] + np.stack([0 * s.image, s.image], axis=1)
    expected = np.where(on_wall, s["contact_point"][:, None, :], centres)
    check(f"{path.name} lines", ends, expected)
    tangential = np.hypot(s["contact_force"][:, 1], s["contact_force"][:, 2])
    size = np.linalg.norm(s["contact_force"], axis=1)
    limit = s.friction * (s["contact_force"][:, 0] + s.attraction)  # of the tangential force, N
    mobilised = np.where(limit > 0, tangential / np.where(limit > 0, limit, 1), 0)
    expected = {
        "mobilised": (mobilised, np.ones(1)),
        "normal_force": (s["contact_force"][:, 0], None),
        "tangential_force": (tangential, size),
        "force": (s.force, size),
        "gap": (s["contact_gap"], None),
        "status": (s["contact_status"], None),
        "active": (s.active.astype("u1"), None),
        "bonded": (s.all.get("contact_bonded", np.zeros(len(s.active), "u1")), None),
        "law": (s["contact_law"], None),
        "candidate": (s["body_id"][s["contact_body"][:, 0]], None),
        "antagonist": (s["body_id"][s["contact_body"][:, 1]], None),
    }
    for name, (values, scale) in expected.items():
        check(f"{path.name} {name}", file.cell.get(name, []), values, scale)
    unknown = set(file.cell) - set(expected)
    if unknown:
        faults.append(f"{path.name}: arrays that are not checked: {sorted(unknown)}")


def loads(s):
    """Force of the contacts on each body, and its moment about the body's centre."""
    force, moment = np.zeros((2, len(s.wall), 3))
    candidate, antagonist = s["contact_body"].T
    for rows, sign, image in ((candidate, 1, 0 * s.image), (antagonist, -1, s.image)):
        arm = s["contact_point"] - (s["body_x"][rows] + image)
        np.add.at(force, rows, sign * s.force)
        np.add.at(moment, rows, np.cross(arm, sign * s.force))
    return force, moment


def check_fields(file, snapshot, arrays):
    """Time, step, names and units of a .vtp file."""
    if file.path.suffix != ".vtp":
        return
    data, meta = file.output().GetFieldData(), snapshot.meta
    found = {data.GetAbstractArray(k).GetName(): data.GetAbstractArray(k) for k in range(data.GetNumberOfArrays())}
    texts = lambda name: [found[name].GetValue(k) for k in range(found[name].GetNumberOfValues())] if name in found else []
    check(f"{file.name} TimeValue", [found["TimeValue"].GetTuple1(0)], [meta["time"]])
    check(f"{file.name} step", [found["step"].GetTuple1(0)], [meta["step"]])
    expected = {
        "material": [material["name"] for material in meta["materials"]],
        "colour": meta["colours"],
        "law": [f"{law['nickname']} {law['kind']}" for law in meta["laws"]],
    }
    for array, names in expected.items():
        if array in arrays and texts(f"{array} names") != names:
            faults.append(f"{file.name} {array} names: {texts(f'{array} names')}, expected {names}")
    if "pressure" in arrays and "pressure (Pa)" not in texts("units"):
        faults.append(f"{file.name} units: {texts('units')}")


def check_walls(path, snapshot):
    file, s = Polydata(path), snapshot
    walls = np.flatnonzero(s.wall)
    plates = [row for row in walls if s["body_shape"][row] == PLANE]
    balls = [row for row in walls if s["body_shape"][row] != PLANE]
    check(f"{path.name} id", file.cell.get("id", []), [s["body_id"][r] for r in balls + [p for p in plates for _ in range(6)]])
    force, moment = loads(s)
    rows = np.array(balls + [p for p in plates for _ in range(6)], int)
    largest = np.abs(s["contact_force"]).sum() + 1e-300
    check(f"{path.name} force", file.cell.get("force", []), force[rows], largest)
    check(f"{path.name} moment", file.cell.get("moment", []), moment[rows], largest * np.abs(s["contact_point"]).max(initial=1))
    unknown = set(file.cell) - {"id", "force", "moment"}
    if unknown:
        faults.append(f"{path.name}: arrays that are not checked: {sorted(unknown)}")
    check(f"{path.name} balls", file.points[file.cells("Verts", 1)[:, 0]], s["body_x"][balls])
    check(f"{path.name} radius", file.point["radius"][file.cells("Verts", 1)[:, 0]], s["body_radius"][balls])
    faces = file.points[file.cells("Polys", 4)].reshape(-1, 6, 4, 3)  # driven polyhedra are not among these cases
    for row, plate in zip(plates, faces):
        half = s["body_half_lengths"][row]
        local = (plate - s["body_x"][row]) @ rotation(s["body_q"][row])
        # Every corner of the box is in three faces; normals point outward.
        check(f"{path.name} corners", np.abs(local), np.broadcast_to(half, local.shape), np.abs(plate).max() + half.max())
        normals = np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 1]) / 4
        middle = local.mean(axis=1)
        areas = np.prod(half) / np.linalg.norm(middle, axis=1)
        check(f"{path.name} faces", (normals * middle).sum(1) / np.linalg.norm(middle, axis=1), areas, 1e3 * areas)
        corners = {tuple(corner) for corner in np.sign(local).reshape(-1, 3)}
        if len(corners) != 8:
            faults.append(f"{path.name}: the plate in row {row} has {len(corners)} corners")


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    case = Path(sys.argv[1])
    checked = 0
    for kind, compare in (("grains", check_grains), ("polyhedra", check_polyhedra), ("contacts", check_contacts), ("walls", check_walls)):
        files = collection(case / "DISPLAY", kind)
        if files is None and kind in ("walls", "polyhedra"):
            continue
        for file in files or []:
            snapshot = Snapshot(file.snapshot)
            check(f"{file.name} time", [file.time], [snapshot.meta["time"]])
            compare(file, snapshot)
            read_back = Polydata(file)
            check_fields(file, snapshot, set(read_back.point) | set(read_back.cell))
            checked += 1
    if checked == 0:
        faults.append(f"{case}: nothing to check")
    for fault in faults:
        print(f"vtk_readback: {fault}", file=sys.stderr)
    print(f"vtk_readback: {case}: {checked} states, {len(faults)} faults")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
