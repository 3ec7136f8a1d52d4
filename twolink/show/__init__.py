"""Figures and playback: plots, pages that play a motion, the live viewer. Imported where something is shown.

In: times, arrays, names and a model with its visuals. Out: pictures, HTML pages, a live view in the browser. This
room does not know how a motion was computed.
"""
