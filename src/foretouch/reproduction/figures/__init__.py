"""The paper's figures and its table, each with the claims that it bears."""
