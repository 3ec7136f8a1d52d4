"""The paper: its figures and claims, and the throws it opens with."""
