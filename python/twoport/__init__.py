"""Passive bilateral teleoperation: scenes in virtual time, and the nodes of master and slave one tick at a time.

    import twoport
    result = twoport.run(twoport.load_scene("demo", "to_slave.delay_ms=20"))
    result.summary["min_port_energy_j"], result.trace["master_f"]

SI units, in names of keys and columns. Forces at the master port are such that force.velocity is power into the network.
"""

try:
    import numpy as _numpy  # noqa: F401
except ImportError as _missing:
    raise ImportError("twoport needs NumPy, which is not installed: python3-numpy of Debian, or pip install numpy") from _missing

from . import _twoport
from ._twoport import *
from ._twoport import __version__

# Scenes and arms of the project stand in a folder above this one: of the source tree, or share/twoport of an installation.
_twoport._look_above(__path__[0])

__all__ = [name for name in dir(_twoport) if not name.startswith("_")] + ["__version__"]
