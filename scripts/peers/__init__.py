"""The contestants of compare_peers.py: one module each, around the same Problem."""
