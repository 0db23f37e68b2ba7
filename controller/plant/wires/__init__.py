"""The wires to plant systems: each is a way for the same payloads, and knows no cell.

A module here is loaded only where the cell file's section `connect` has its key.
"""
