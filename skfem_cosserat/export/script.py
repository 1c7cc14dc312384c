"""The script that is written beside the files for ParaView, and shows them there."""

from __future__ import annotations

#: text of ``paraview.py``; it runs in ParaView's Python, from 5.11 on
SCRIPT = '''\
"""Shows the files beside it in ParaView (5.11 or later).

In ParaView: View > Python Shell > Run Script. Or a picture of the last state, without a window:

    pvpython paraview.py picture.png
"""

import os
import sys

HERE = os.path.dirname(os.path.abspath(globals().get("__file__", "paraview.py")))
sys.path[:] = [path for path in sys.path if os.path.abspath(path or ".") != HERE]  # its own name

from paraview.simple import *  # noqa: E402

paraview.simple._DisableFirstRenderCameraReset()
view = GetActiveViewOrCreate("RenderView")
view.Background = [1.0, 1.0, 1.0]
view.UseColorPaletteForBackground = 0
view.OrientationAxesLabelColor = [0.0, 0.0, 0.0]
unit = UNIT  # of what the time of the files is

layers = {}
for name in "beams beam_surfaces bodies joints drives loads couplings".split():
    if os.path.exists(os.path.join(HERE, name + ".pvd")):
        layers[name] = PVDReader(registrationName=name, FileName=os.path.join(HERE, name + ".pvd"))
if not layers:
    raise SystemExit("there are no files to show in " + HERE)
scene = GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
times = list(next(iter(layers.values())).TimestepValues)
looked_at = times[:: max(1, len(times) // 20)] + times[-1:]


def largest(source, name):
    """Largest norm of an array of points over time."""
    found = 0.0
    for time in looked_at:
        source.UpdatePipeline(time)
        array = source.PointData.GetArray(name)
        if array is not None and source.GetDataInformation().GetNumberOfPoints():
            ends = array.GetRange(-1 if array.GetNumberOfComponents() > 1 else 0)
            found = max([found] + [abs(end) for end in ends if end == end])
    return found


def size():
    """Largest extent of the scene over time (m)."""
    found = 0.0
    for source in layers.values():
        for time in looked_at:
            source.UpdatePipeline(time)
            b = source.GetDataInformation().GetBounds()
            found = max(found, b[1] - b[0], b[3] - b[2], b[5] - b[4])
    return found or 1.0


def bending(source):
    """Beams with the norm of the bending moment at their points, if it is known."""
    if source.PointData.GetArray("M") is None:
        return source
    return Calculator(
        Input=source, ResultArrayName="bending moment in N m", Function="sqrt(M_X^2+M_Y^2)"
    )


extent = size()
beams = []
if "beam_surfaces" in layers:
    beams.append(bending(layers["beam_surfaces"]))
if "beams" in layers:
    lines = layers["beams"]
    if "beam_surfaces" in layers:  # tubes for what has no outline
        lines = Threshold(Input=lines, Scalars=["CELLS", "outlined"])
        lines.LowerThreshold, lines.UpperThreshold = 0.0, 0.5
    lines.UpdatePipeline(times[-1])
    if lines.GetDataInformation().GetNumberOfCells():
        tube = Tube(Input=ExtractSurface(Input=bending(lines)), NumberofSides=12)
        if lines.PointData.GetArray("radius") is not None:
            tube.Scalars = ["POINTS", "radius"]
            tube.VaryRadius = "By Absolute Scalar"
        else:
            tube.Radius = 0.005 * extent
        beams.append(tube)
top = 0.0
for source in beams:
    source.UpdatePipeline(times[-1])
    display = Show(source, view)
    display.DiffuseColor = display.AmbientColor = [0.27, 0.51, 0.71]
    display.Ambient = 0.4
    if source.PointData.GetArray("bending moment in N m") is not None:
        ColorBy(display, ("POINTS", "bending moment in N m"))
        top = max(top, largest(source, "bending moment in N m"))
if top:
    table = GetColorTransferFunction("bending moment in N m")
    table.ApplyPreset("Viridis (matplotlib)", True)
    table.RescaleTransferFunction(0.0, top)
    bar = GetScalarBar(table, view)
    bar.Visibility = 1
    bar.Title, bar.ComponentTitle = "bending moment in N m", ""
    bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]

for name, color, width in (
    ("bodies", [0.6, 0.65, 0.75], 10),
    ("joints", [0.7, 0.13, 0.13], 12),
    ("drives", [0.9, 0.5, 0.1], 16),
    ("loads", [0.1, 0.5, 0.2], 6),
    ("couplings", [0.4, 0.2, 0.6], 6),
):
    if name in layers:
        layers[name].UpdatePipeline(times[-1])
        display = Show(layers[name], view)
        display.ColorArrayName = [None, ""]
        display.DiffuseColor = display.AmbientColor = color
        display.Ambient = 0.3
        display.PointSize, display.LineWidth = width, 4
        display.RenderPointsAsSpheres = 1
        force = largest(layers[name], "force") if name in ("joints", "loads") else 0.0
        if force:
            arrows = Glyph(Input=layers[name], GlyphType="Arrow")
            arrows.OrientationArray = arrows.ScaleArray = ["POINTS", "force"]
            arrows.ScaleFactor, arrows.GlyphMode = 0.25 * extent / force, "All Points"
            display = Show(arrows, view)
            display.ColorArrayName = [None, ""]
            display.DiffuseColor = display.AmbientColor = color

clock = AnnotateTimeFilter(Input=next(iter(layers.values())))
clock.Format = "t = {time:.4g} s" if unit == "s" else unit + " = {time:.4g}"
Show(clock, view).Color = [0.0, 0.0, 0.0]
scene.GoToLast()
view.ViewTime = times[-1]
view.ApplyIsometricView()
if len(sys.argv) > 1:
    view.ViewSize = [1600, 900]
    view.ResetCamera(True)
    SaveScreenshot(sys.argv[1], view)
else:
    view.ResetCamera(True)
    Render(view)
'''
