"""The hybrid engine: smooth segments between located events. It knows locks, stops, contacts and triggers, no effects.

snapshot      accelerations, forces and what guards look at, of states in one mode
modes         the modes of a scene, and the equations of each
consistency   the mode that is consistent with the laws of friction and contact
impacts       velocities after an impact; bounces too low to follow come to rest, all at once
state         time, motion, mode and events of a run; contacts at corners and edges, and how one follows another
transitions   the guards of a mode, and what their zeros do
roots         zeros and minima by evaluations in batches
locating      guards, values that end a mode where they pass 0, and segments up to the first zero of one
engine        one solution, segment by segment
located       solutions side by side as a motion, and runs for samples
"""
