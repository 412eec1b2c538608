"""The paper's case study from nothing: every figure and number of it, ours beside the paper's and the bound."""
