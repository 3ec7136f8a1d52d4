// The torques that hold the two-link arm still. Before: twolink export two_link arm.c --functions inverse_dynamics
#include <cstdio>

#include "arm.h"

int main() {
  const arm_real q[2] = {0.3, 0.5}, still[2] = {0, 0};  // rad
  arm_real tau[2];
  arm_inverse_dynamics(q, still, still, tau);
  std::printf("%.12f %.12f N m\n", tau[0], tau[1]);
}
