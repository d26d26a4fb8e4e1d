"""Peers that need packages of their own: programs run in an environment of their own, without this one."""
