# Shows this folder in ParaView: the grains as spheres and polyhedra, the walls, the chains of force as tubes.
#
#     paraview --script=view.py        in a window (or there: File > Load State)
#     pvbatch view.py PICTURE.png      the last snapshot as a picture
#
# cd-post writes this file anew each time: change a copy.
import os
import sys

from paraview.simple import *

# A window does not tell a script where it lies.
HERE = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else "@FOLDER@"
# Names of the values of the arrays `material`, `colour` and `law`.
NAMES = "@NAMES@"
# Radius of the tubes of the largest and of the smallest force, in mean radii of the grains.
THICKEST, THINNEST = 0.4, 0.01


def read(kind):
    """The data of this kind at all times, in either format; None if there are none."""
    path = os.path.join(HERE, kind + ".pvd")
    if os.path.exists(path):
        return PVDReader(registrationName=kind, FileName=path)
    path = os.path.join(HERE, kind + ".vtkhdf")
    return VTKHDFReader(registrationName=kind, FileName=[path]) if os.path.exists(path) else None


def name_values(array):
    """Shows the names of the values of an array instead of numbers, when something is coloured by it."""
    table = GetColorTransferFunction(array)
    table.InterpretValuesAsCategories = 1
    table.AnnotationsInitialized = 1
    table.Annotations = [text for k, name in enumerate(NAMES[array]) for text in (str(k), name)]
    table.IndexedColors = [c for k in range(len(NAMES[array])) for c in PALETTE[k % len(PALETTE)]]


def colour(display, where, array, title, seen=True):
    """By an array without negative values, from 0 to the largest in all that is shown so."""
    ColorBy(display, (where, array))
    display.RescaleTransferFunctionToDataRange(True, True)
    table = GetColorTransferFunction(array)
    # ParaView widens a range of one value by its rounding.
    table.RescaleTransferFunction(0.0, max(float("%.4g" % table.RGBPoints[-4]), 1e-30))
    bar = GetScalarBar(table, view)
    bar.Title, bar.ComponentTitle = title, ""
    bar.TitleFontSize = bar.LabelFontSize = 8
    bar.LabelFormat = bar.RangeLabelFormat = "%g"
    display.SetScalarBarVisibility(view, seen)


# Okabe & Ito (2008): distinguishable by colour-blind readers.
PALETTE = [(0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.0, 0.62, 0.45), (0.8, 0.47, 0.65), (0.9, 0.62, 0.0), (0.34, 0.71, 0.91)]
view = GetActiveViewOrCreate("RenderView")
view.OrientationAxesVisibility = 1
scene = GetAnimationScene()
grains, polyhedra, contacts, walls = (read(kind) for kind in ("grains", "polyhedra", "contacts", "walls"))
scene.UpdateAnimationUsingDataTimeSteps()
scene.GoToLast()
# Pipelines that are not shown have the first time unless they are given one.
last = view.ViewTime

spheres = Threshold(registrationName="spheres", Input=grains, Scalars=["POINTS", "polyhedron"])
spheres.LowerThreshold = spheres.UpperThreshold = 0
spheres.UpdatePipeline(last)
if spheres.GetDataInformation().GetNumberOfPoints() > 0:
    display = Show(spheres, view)
    display.SetRepresentationType("3D Glyphs")
    display.GlyphType = "Sphere"
    display.GlyphType.ThetaResolution = display.GlyphType.PhiResolution = 20
    display.Scaling = 1
    display.ScaleMode = "Magnitude"
    display.SelectScaleArray = "radius"
    display.ScaleFactor = 2.0  # the glyph has the diameter 1
    colour(display, "POINTS", "neighbours", "neighbours")
if polyhedra:
    display = Show(polyhedra, view)
    display.SetRepresentationType("Surface")
    colour(display, "CELLS", "neighbours", "neighbours")
for array in NAMES:
    name_values(array)
chains = Threshold(registrationName="contacts with force", Input=contacts, Scalars=["CELLS", "active"])
chains.LowerThreshold = chains.UpperThreshold = 1
chains.UpdatePipeline(last)
if chains.GetDataInformation().GetNumberOfCells() > 0:
    # Each line gets points of its own, with its force.
    lines = Shrink(registrationName="lines", Input=chains, ShrinkFactor=1.0)
    forces = CellDatatoPointData(registrationName="forces at both ends", Input=lines)
    surface = ExtractSurface(registrationName="lines with forces", Input=forces)
    tubes = Tube(registrationName="chains of force", Input=surface, Scalars=["POINTS", "normal_force"])
    grains.UpdatePipeline(last)
    radii = grains.GetDataInformation().GetPointDataInformation().GetArrayInformation("radius").GetComponentRange(0)
    mean = 0.5 * (radii[0] + radii[1])
    tubes.VaryRadius, tubes.Radius, tubes.RadiusFactor = "By Scalar", THINNEST * mean, THICKEST / THINNEST
    display = Show(tubes, view)
    colour(display, "POINTS", "normal_force", "normal force, N", seen=False)
    Hide(tubes, view)  # within the grains: the eye next to it in the pipeline shows them

view.CameraFocalPoint, view.CameraPosition, view.CameraViewUp = [0, 0, 0], [1.0, -1.6, 0.9], [0, 0, 1]
ResetCamera(view)
if walls:
    display = Show(walls, view)
    display.SetRepresentationType("Surface")
    ColorBy(display, None)
    display.AmbientColor = display.DiffuseColor = [0.59, 0.61, 0.65]
    display.Opacity = 0.1
Render(view)
if len(sys.argv) > 1 and sys.argv[-1].endswith(".png"):
    SaveScreenshot(sys.argv[-1], view, ImageResolution=[1600, 1200])
