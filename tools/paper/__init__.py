"""The data of the paper's figures."""
