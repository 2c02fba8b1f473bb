"""Land or air: the energy model, the decision, and the transition machine."""
