"""The flight of one search: links, permission, set-points."""
