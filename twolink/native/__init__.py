"""The machine: runs traced formulas, and steps of methods on them, over columns of numbers, without a compiler.

Comes in: tapes (`algorithms.tape`), as operations with inputs and outputs; tableaus and control rows as arrays.
Goes out: programs (`machine.Program`) and methods (`stepper.Stepper`) that run in one C99 library of our own, built
with the wheel; without it NumPy runs the same programs.
Does not know: robots, effects, equations of motion.
"""
