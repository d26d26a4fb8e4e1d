"""Trajectories: steps, meshes, friction with sticking, very many cycles."""
