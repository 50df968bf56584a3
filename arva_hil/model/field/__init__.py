"""The field of the transmitters: dipoles and their motion, geodesy, rotations. NED, metres. Needs only numpy."""

from .dipole import Transmitters, dipole_field
from .geodesy import LocalFrame
from .motion import Following, MovingTransmitters, Waypoints
from .mount import Mount

__all__ = ["Following", "LocalFrame", "Mount", "MovingTransmitters", "Transmitters", "Waypoints", "dipole_field"]
