"""One of each kind that a package may add to arva-hil; its entry points name them."""
