"""Simulated records that no law fits, or of bad quality: does the answer warn?"""
