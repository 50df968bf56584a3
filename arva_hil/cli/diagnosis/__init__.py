"""The checks of `arva-hil doctor`: `examination` measures both links, `diagnosis` says what the figures mean."""
