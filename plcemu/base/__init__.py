"""What everything else stands on: errors, places in a text, time, types, tags and traces.

Standard library only; imports nothing else of this project.
"""
