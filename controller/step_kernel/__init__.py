"""The STEP kernel (Open CASCADE 7.9) at work: the code of its own process.

Kernels crash, hang and eat memory on damaged files. `controller.cad.reading.step` therefore starts
one of the modules `solid`, `bodies` and `tolerances` as a process, with limits on its memory and
its time. Nothing here imports another package of the controller, and none imports this one.
"""
