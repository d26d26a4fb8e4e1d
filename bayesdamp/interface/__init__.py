"""Define the interface in Python, which `bayesdamp` offers, over what the other packages compute.

Each module has one public class or function, or what several of these share.
"""
