"""What the paper's figures are drawn from."""
