"""ROS 2 messages made from events: declarations, their CDR bytes, and their `ros2msg` schemas.

The world is ENU, bodies are FLU (REP 103), unlike everywhere else in arva-hil; `frames` converts.
"""
