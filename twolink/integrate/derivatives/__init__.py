"""Derivatives of a motion by its start and by parameters: variational equations."""
