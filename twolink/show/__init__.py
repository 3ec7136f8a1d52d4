"""Showing: figures, playback in the browser, reports. Imported where something is shown, never before."""
