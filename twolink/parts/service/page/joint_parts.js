// What the numbers of a joint's q, v and tau are, in order, by the joint's layout; joints of one number are not listed.

const ANGULAR = ["ωx", "ωy", "ωz"];
const ROTATION = ["qx", "qy", "qz", "qw"];

export const Q_PARTS = {
  "free-flyer": ["x", "y", "z", ...ROTATION],
  quaternion: ROTATION,
  planar: ["x", "y", "cos", "sin"],
  "cos-sin": ["cos", "sin"],
};
export const V_PARTS = {
  "free-flyer": ["vx", "vy", "vz", ...ANGULAR],
  quaternion: ANGULAR,
  planar: ["vx", "vy", "ω"],
};
export const TAU_PARTS = {
  "free-flyer": ["Fx", "Fy", "Fz", "Mx", "My", "Mz"],
  quaternion: ["Mx", "My", "Mz"],
  planar: ["Fx", "Fy", "M"],
};
