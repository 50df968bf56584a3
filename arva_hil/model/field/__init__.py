"""The field of the transmitters: dipoles and their motion, geodesy, rotations. NED, metres. Needs only numpy."""

from .dipole import Following, MovingTransmitters, Transmitters, Waypoints, dipole_field
from .geodesy import LocalFrame
from .rotation import Mount

__all__ = ["Following", "LocalFrame", "Mount", "MovingTransmitters", "Transmitters", "Waypoints", "dipole_field"]
