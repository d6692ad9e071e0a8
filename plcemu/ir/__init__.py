"""The intermediate representation: the border between the language and the machine.

Typed stack code over one flat block of memory. Everything a program can do, faults included, is
defined here, so that every engine agrees.
"""
