"""Define the classes and functions of `import bayesdamp`.

Each module contains public classes and functions that belong together, or helpers of several of them.
"""
