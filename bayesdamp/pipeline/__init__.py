"""The pipeline of a study: a graph of independent, named cells, and the one room that knows all the others."""
