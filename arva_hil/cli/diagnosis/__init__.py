"""The checks of `arva-hil doctor`: `examination` measures both links, `diagnosis` judges the figures."""
