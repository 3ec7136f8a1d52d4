"""The paper's arm, as Pinocchio has it."""

import pinocchio as pin
import pytest

from tests.show.pieces import URDF, Robot


@pytest.fixture(scope="session")
def arm() -> Robot:
    model = pin.buildModelFromUrdf(str(URDF))
    return model, pin.buildGeomFromUrdf(model, str(URDF), pin.GeometryType.VISUAL)
