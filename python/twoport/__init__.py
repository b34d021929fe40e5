"""Passive bilateral teleoperation: scenes in virtual time, and the nodes of master and slave one tick at a time.

    import twoport
    result = twoport.run(twoport.load_scene("scenes/demo.textproto", "to_slave.delay_ms=20"))
    result.summary["min_port_energy_j"], result.trace["master_f"]

SI units, in names of keys and columns. Forces at the master port are such that force.velocity is power into the network.
"""

from . import _twoport
from ._twoport import *
from ._twoport import __version__

__all__ = [name for name in dir(_twoport) if not name.startswith("_")] + ["__version__"]
