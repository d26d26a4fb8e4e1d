"""Define the classes and functions of `import bayesdamp`.

Each module contains one public class or function, or helpers of several of them.
"""
