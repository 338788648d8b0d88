"""The usual picture in ParaView: deformed bodies with von Mises stress, and the pressure on contacts.

Run it as a macro (Macros, Import New Macro) on a fields.pvd that is open, or on one by
`paraview --script=paraview_view.py` in the folder of the results, or `pvpython paraview_view.py fields.pvd`.
It is copied to the results that `output.vtu` asks for; SCALE may be changed.
"""

from __future__ import annotations

import os
import sys
from typing import Any

SCALE = None  # of the displacement; None: the largest one is drawn as a tenth of the bodies' size
SHARE, SMALL = 0.1, 1e-300
THROUGH = 0.4  # opacity of solid bodies, through which contacts are seen
FROM = (-1.0, -1.6, 0.6)  # where solid bodies are seen from


def show(pv: Any, source: Any, scale: float | None) -> Any:
    """Draw the last step of an open fields.pvd; returns the view.

    Args:
        pv: the module paraview.simple.
    """
    scene = pv.GetAnimationScene()
    scene.UpdateAnimationUsingDataTimeSteps()
    scene.GoToLast()
    view = pv.GetActiveViewOrCreate("RenderView")
    view.ViewTime = source.TimestepValues[-1]
    source.UpdatePipeline(view.ViewTime)
    pv.Hide(source, view)
    ends = source.GetDataInformation().GetBounds()
    low, high = ends[0::2], ends[1::2]
    size = sum((high[axis] - low[axis]) ** 2 for axis in range(3)) ** 0.5
    moved = max(abs(end) for end in source.PointData["displacement"].GetRange(-1))
    factor = SHARE * size / max(moved, SMALL) if scale is None else scale
    warped = pv.WarpByVector(registrationName=f"displacement x {factor:.3g}", Input=source)
    warped.Vectors = ["POINTS", "displacement"]
    warped.ScaleFactor = factor
    pv.Hide(warped, view)
    flat = low[2] == high[2]
    for group, field in (("bodies", "nodal_von_mises"), ("contacts", "pressure")):
        part = pv.ExtractBlock(registrationName=group, Input=warped)
        part.Selectors = [f"/Root/{group}"]
        display = pv.Show(part, view)
        pv.ColorBy(display, ("POINTS", field))
        display.RescaleTransferFunctionToDataRange(True, False)
        display.SetScalarBarVisibility(view, True)
        if group == "contacts":
            display.LineWidth, display.PointSize = 6, 6
            pv.GetColorTransferFunction(field).ApplyPreset("Inferno (matplotlib)", True)
        if group == "bodies" and not flat:
            display.Opacity = THROUGH
    view.InteractionMode = "2D" if flat else "3D"
    if not flat:  # z is up
        centre = [(low[axis] + high[axis]) / 2 for axis in range(3)]
        view.CameraFocalPoint, view.CameraViewUp = centre, [0.0, 0.0, 1.0]
        view.CameraPosition = [centre[axis] + size * FROM[axis] for axis in range(3)]
    view.ResetCamera(False)
    pv.Render(view)
    return view


def main() -> None:
    """Show the file that is named, or what is active in ParaView, or the file beside this one."""
    import paraview.simple as pv

    named = [word for word in sys.argv[1:] if word.endswith(".pvd")]
    beside = os.path.join(os.path.dirname(os.path.abspath(globals().get("__file__", "x"))), "fields.pvd")
    source = None if named else pv.GetActiveSource()
    show(pv, source or pv.OpenDataFile(named[0] if named else beside), SCALE)


if __name__ == "__main__":
    main()
