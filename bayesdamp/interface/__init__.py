"""Define the classes and functions of `import bayesdamp`.

Each module contains one public class, function or both, or helpers of several of them.
"""
