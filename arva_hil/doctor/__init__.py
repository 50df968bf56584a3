"""What `arva-hil doctor` knows: `examination` measures both links, `diagnosis` says what it means."""
