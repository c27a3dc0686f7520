# PyChrono script generated from SolidWorks using Chrono::SolidWorks add-in
import builtins

import pychrono as chrono

shapes_dir = "rod_shapes/"
if hasattr(builtins, "exported_system_relpath"):
    shapes_dir = builtins.exported_system_relpath + shapes_dir
exported_items = []
body_0 = chrono.ChBodyAuxRef()
body_0.SetName("ground")
body_0.SetFixed(True)
exported_items.append(body_0)

body_1 = chrono.ChBodyAuxRef()
body_1.SetName("rod")
body_1.SetPos(chrono.ChVector3d(0.0, 0.0, 0.0))
body_1.SetRot(chrono.ChQuaterniond(1.0, 0.0, 0.0, 0.0))
body_1.SetMass(1.0)
body_1.SetInertiaXX(chrono.ChVector3d(0.0002666666666666667, 0.013466666666666667, 0.013466666666666667))
body_1.SetInertiaXY(chrono.ChVector3d(0.0, 0.0, 0.0))
body_1.SetFrameCOMToRef(chrono.ChFramed(chrono.ChVector3d(0.2, 0.0, 0.0), chrono.ChQuaterniond(1, 0, 0, 0)))

exported_items.append(body_1)

link = chrono.ChLinkMateParallel()
link.SetFlipped(True)
link.Initialize(
    body_0,
    body_1,
    False,
    chrono.ChVector3d(0.0, 0.0, 0.0),
    chrono.ChVector3d(0.0, 0.1, 0.0),
    chrono.ChVector3d(0.0, 1.0, 0.0),
    chrono.ChVector3d(-0.0, -1.0, -0.0),
)
link.SetName("Concentric1")
exported_items.append(link)

link = chrono.ChLinkMateGeneric()
link.SetConstrainedCoords(True, True, False, False, False, False)
link.Initialize(
    body_0,
    body_1,
    False,
    chrono.ChVector3d(0.0, 0.0, 0.0),
    chrono.ChVector3d(0.0, 0.1, 0.0),
    chrono.ChVector3d(0.0, 1.0, 0.0),
    chrono.ChVector3d(-0.0, -1.0, -0.0),
)
link.SetName("Concentric1")
exported_items.append(link)

link = chrono.ChLinkMateDistanceZ()

link.Initialize(
    body_0,
    body_1,
    False,
    chrono.ChVector3d(0.0, 0.0, -1.0),
    chrono.ChVector3d(0.0, 0.0, 1.0),
    chrono.ChVector3d(0.0, 1.0, 0.0),
)
link.SetName("Coincident1")
exported_items.append(link)

link = chrono.ChLinkMateParallel()

link.Initialize(
    body_0,
    body_1,
    False,
    chrono.ChVector3d(0.0, 0.0, -1.0),
    chrono.ChVector3d(0.0, 0.0, 1.0),
    chrono.ChVector3d(0.0, 1.0, 0.0),
    chrono.ChVector3d(0.0, 1.0, 0.0),
)
link.SetName("Coincident1")
exported_items.append(link)
