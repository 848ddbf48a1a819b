"""Writes the meshes of `.vtu`, `.vtp` and `.msh` beside this file, by programs other than Kerf.

    pip install vtk==9.7.2 gmsh==4.15.2 meshio==5.3.5
    python tests/corpus/make_meshes.py

Each is a body whose volume and area are known: `server/scenes/tests/foreign_meshes.rs` compares.
"""

from pathlib import Path

import gmsh
import meshio
import numpy as np
import vtk

HERE = Path(__file__).parent
#: Edges of the box, which begins at the origin.
BOX = (1.0, 2.0, 3.0)


def bar() -> vtk.vtkUnstructuredGrid:
    """Three unit cubes in a row: a voxel, two wedges, six pyramids; and one by itself, of five tetrahedra."""
    points, grid = vtk.vtkPoints(), vtk.vtkUnstructuredGrid()
    points.SetDataTypeToDouble()

    def square(x: float) -> list[int]:
        return [points.InsertNextPoint(x, y, z) for y, z in [(0, 0), (1, 0), (1, 1), (0, 1)]]

    def cell(kind: int, nodes: list[int]) -> None:
        grid.InsertNextCell(kind, len(nodes), nodes)

    a, b, c, d = (square(x) for x in range(4))
    cell(vtk.VTK_VOXEL, [a[0], b[0], a[1], b[1], a[3], b[3], a[2], b[2]])
    cell(vtk.VTK_WEDGE, [b[0], b[1], c[0], b[3], b[2], c[3]])
    cell(vtk.VTK_WEDGE, [b[1], c[1], c[0], b[2], c[2], c[3]])
    middle = points.InsertNextPoint(2.5, 0.5, 0.5)
    for i in range(4):
        j = (i + 1) % 4
        cell(vtk.VTK_PYRAMID, [c[i], c[j], d[j], d[i], middle])
    cell(vtk.VTK_PYRAMID, [*c, middle])
    cell(vtk.VTK_PYRAMID, [*d, middle])
    e, f = square(5), square(6)
    for nodes in [
        [e[0], e[1], e[3], f[0]],
        [e[2], e[3], e[1], f[2]],
        [f[1], f[0], f[2], e[1]],
        [f[3], f[2], f[0], e[3]],
        [e[1], e[3], f[0], f[2]],
    ]:
        cell(vtk.VTK_TETRA, nodes)
    # What bounds nothing.
    cell(vtk.VTK_LINE, [a[0], f[0]])
    cell(vtk.VTK_VERTEX, [points.InsertNextPoint(9, 9, 9)])
    grid.SetPoints(points)
    return grid


def box_faces() -> vtk.vtkPolyData:
    source = vtk.vtkCubeSource()
    source.SetBounds(0, BOX[0], 0, BOX[1], 0, BOX[2])
    clean = vtk.vtkCleanPolyData()
    clean.SetInputConnection(source.GetOutputPort())
    clean.Update()
    return clean.GetOutput()


def box_strips() -> vtk.vtkPolyData:
    triangles, strips = vtk.vtkTriangleFilter(), vtk.vtkStripper()
    triangles.SetInputData(box_faces())
    strips.SetInputConnection(triangles.GetOutputPort())
    strips.Update()
    assert strips.GetOutput().GetNumberOfStrips() > 0
    return strips.GetOutput()


def write(writer: vtk.vtkXMLWriter, name: str, data: vtk.vtkDataSet | None, *settings: str) -> None:
    writer.SetFileName(str(HERE / name))
    if data is not None:
        writer.SetInputData(data)
    writer.SetCompressorTypeToNone()
    for setting in settings:
        getattr(writer, setting)()
    assert writer.Write() == 1, name


def write_vtk() -> None:
    grid, polygons = vtk.vtkXMLUnstructuredGridWriter, vtk.vtkXMLPolyDataWriter
    little, big = "SetByteOrderToLittleEndian", "SetByteOrderToBigEndian"
    short, long = "SetHeaderTypeToUInt32", "SetHeaderTypeToUInt64"
    base64, raw, zlib = "EncodeAppendedDataOn", "EncodeAppendedDataOff", "SetCompressorTypeToZLib"
    write(grid(), "bar-ascii.vtu", bar(), "SetDataModeToAscii")
    write(grid(), "bar-inline.vtu", bar(), "SetDataModeToBinary", short, big)
    write(grid(), "bar-inline-zlib.vtu", bar(), "SetDataModeToBinary", long, zlib)
    write(grid(), "bar-raw.vtu", bar(), "SetDataModeToAppended", raw, long, little)
    write(grid(), "bar-base64-zlib.vtu", bar(), "SetDataModeToAppended", base64, zlib, short, big)
    blocks = grid()
    blocks.SetBlockSize(128)
    write(blocks, "bar-blocks.vtu", bar(), "SetDataModeToAppended", raw, zlib, long)
    extract = vtk.vtkExtractUnstructuredGridPiece()
    extract.SetInputData(bar())
    extract.CreateGhostCellsOff()
    pieces = grid()
    pieces.SetInputConnection(extract.GetOutputPort())
    pieces.SetNumberOfPieces(3)
    write(pieces, "bar-pieces.vtu", None, "SetDataModeToAscii")
    write(polygons(), "box-ascii.vtp", box_faces(), "SetDataModeToAscii")
    write(polygons(), "box-base64.vtp", box_faces(), "SetDataModeToAppended", base64, long)
    write(polygons(), "box-strips.vtp", box_strips(), "SetDataModeToBinary", zlib, short)


def write_gmsh() -> None:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    for name, order, version, binary in [
        ("box-22-text.msh", 1, 2.2, 0),
        ("box-22-binary.msh", 1, 2.2, 1),
        ("box-41-text.msh", 1, 4.1, 0),
        ("box-41-binary.msh", 1, 4.1, 1),
        ("box-41-quadratic.msh", 2, 4.1, 1),
    ]:
        gmsh.model.add(name)
        box = gmsh.model.occ.addBox(0, 0, 0, *BOX)
        gmsh.model.occ.synchronize()
        # In two groups, which version 2 writes an element for each of.
        gmsh.model.addPhysicalGroup(3, [box], name="liver")
        gmsh.model.addPhysicalGroup(3, [box], name="all")
        gmsh.option.setNumber("Mesh.MeshSizeMin", 3)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(HERE / name))
    # Surfaces alone, with parameters beside the coordinates.
    gmsh.model.add("surfaces")
    gmsh.model.occ.addBox(0, 0, 0, *BOX)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)
    gmsh.option.setNumber("Mesh.SaveParametric", 1)
    gmsh.option.setNumber("Mesh.Binary", 0)
    gmsh.write(str(HERE / "box-parametric.msh"))
    gmsh.finalize()


def write_meshio() -> None:
    corners = np.array([(x, y, z) for x in (0, BOX[0]) for y in (0, BOX[1]) for z in (0, BOX[2])], dtype=np.float32)
    mesh = meshio.Mesh(corners.astype(np.float64), [("hexahedron", [[0, 4, 6, 2, 1, 5, 7, 3]])])
    meshio.write(HERE / "box-meshio.vtu", mesh, file_format="vtu", binary=True)
    meshio.write(HERE / "box-meshio-22.msh", mesh, file_format="gmsh22", binary=True)
    meshio.write(HERE / "box-meshio-41.msh", mesh, file_format="gmsh", binary=True)


if __name__ == "__main__":
    write_vtk()
    write_gmsh()
    write_meshio()
