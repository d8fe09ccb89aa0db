from pylmgc90 import chipy
import math
dt = 1.e-3
theta = 0.5
nb_steps = int(1.0 / dt)
tol, relax = 1.666e-4, 1.0
def options():
    chipy.nlgs_3D_DiagonalResolution()
chipy.Initialize()
chipy.checkDirectories()
chipy.SetDimension(3)
chipy.TimeEvolution_SetTimeStep(dt)
chipy.Integrator_InitTheta(theta)
chipy.ReadDatbox(deformable=False)
chipy.PRPRx_UseCpCundallDetection(40)
chipy.PRPRx_LowSizeArrayPolyr(20)
for k in range(1, nb_steps + 1):
    chipy.IncrementStep()
    chipy.ComputeFext()
    chipy.ComputeBulk()
    chipy.ComputeFreeVelocity()
    chipy.SelectProxTactors()
    chipy.RecupRloc()
    chipy.ExSolver('Stored_Delassus_Loops         ', 'Quad ', tol, relax, 20, 50)
    chipy.StockRloc()
    chipy.ComputeDof()
    chipy.UpdateStep()
    chipy.WriteOut(100)
chipy.Finalize()
