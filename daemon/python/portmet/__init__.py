# SPDX-License-Identifier: MIT
"""Python's door to portmet: scenes to step, their files as objects, and the trainer.

    import portmet
    scene = portmet.Scene("configs/double_pendulum.yaml")
    scene.step(200)
    print(scene.energy, scene["upper"].state)

Arrays of a scene are numpy arrays on the memory of libportmet.so: nothing is copied, and every step
updates them. daemon/LIBRARY.md has the details.
"""
from ._library import Error, version
from .files import Dataset, Recording, Weights
from .fleet import Fleet
from .listener import Listener
from .plot import plot
from .remote import Remote
from .scene import Part, Scene
from .train import Estimate, Evaluation, Fit, Proposal, evaluate, fit, import_tables, propose

__version__ = version()
__all__ = ["Dataset", "Error", "Estimate", "Evaluation", "Fit", "Fleet", "Listener", "Part", "Proposal", "Recording", "Remote",
           "Scene", "Weights", "evaluate", "fit", "import_tables", "plot", "propose", "version"]
