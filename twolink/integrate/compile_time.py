"""How long compiling takes, estimated from the number of operations, and what is too long to do unasked."""

MAX_COMPILING = 20.0  # s: code that takes longer to compile is not compiled unasked


def compiling_seconds(operations: float) -> float:
    """Seconds to compile so many operations, roughly: measured on UR5 (8,000: 2 s), ANYmal (44,000) and Talos."""
    return operations / 4_000 * (1.0 + operations / 20_000)
