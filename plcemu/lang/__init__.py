"""The language front end: texts of IEC 61131-3 in, intermediate representation out.

The passes are read aloud in `compile`. Nothing here knows an engine.
"""
