"""One frozen model of a case, the rules between its parts, and the filter models that follow from it."""
