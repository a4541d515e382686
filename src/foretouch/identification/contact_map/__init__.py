"""How a contact map is learnt: the bank of experts, the regression of its maps, and the scores that share the force."""
