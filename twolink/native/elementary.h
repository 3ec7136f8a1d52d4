/* Elementary functions of numbers of C parts, relative to which their errors are a few units; of one part, libm's. */
#if C == 1
static void N(sine)(NUMBER a, NUMBER *s, NUMBER *c) { *s = N(of)(sin(a.part[0])), *c = N(of)(cos(a.part[0])); }
static NUMBER N(root)(NUMBER a) { return N(of)(sqrt(a.part[0])); }
static NUMBER N(exponential)(NUMBER a) { return N(of)(exp(a.part[0])); }
static NUMBER N(hyperbolic)(NUMBER a) { return N(of)(tanh(a.part[0])); }
static NUMBER N(angle)(NUMBER y, NUMBER x) { return N(of)(atan2(y.part[0], x.part[0])); }
static NUMBER N(power)(NUMBER a, double k) { return N(of)(pow(a.part[0], k)); }
#else

/* a - k c for a constant c of four parts, which are enough for k below 2^50. */
static NUMBER N(reduced)(NUMBER a, double k, const double *c) {
  double sum[4] = {0};
  for (int i = 0; i < C; i++) sum[i] = a.part[i];
  for (int i = 0; i < 4; i++) {
    double p, e;
    tl_two_product(-k, c[i], &p, &e);
    tl_add(4, sum, i, p);
    if (i < 3) tl_add(4, sum, i + 1, e);
  }
  for (int from = 0; from < 3; from++)
    for (int i = 2; i >= from; i--) tl_two_sum(sum[i], sum[i + 1], &sum[i], &sum[i + 1]);
  return N(normal)(sum);
}

/* sin a and cos a: r = a - k pi/2, the series of both, and the quarter. NaN where |a| is above 2^50. */
static void N(sine)(NUMBER a, NUMBER *s, NUMBER *c) {
  const double k = rint(a.part[0] * 0.63661977236758138);
  if (!(fabs(k) < 1125899906842624.0)) {
    *s = *c = N(of)(NAN);
    return;
  }
  const NUMBER r = N(reduced)(a, k, TL_HALF_PI), square = N(negative)(N(times)(r, r));
  NUMBER sines = r, cosines = N(of)(1.0), odd = r, even = N(of)(1.0);
  for (int i = 1; i < 20 && (i < 4 || fabs(even.part[0]) > 1e-54); i++) {
    even = N(over)(N(times)(even, square), N(of)((2.0 * i - 1.0) * (2.0 * i)));
    odd = N(over)(N(times)(odd, square), N(of)((2.0 * i) * (2.0 * i + 1.0)));
    cosines = N(plus)(cosines, even), sines = N(plus)(sines, odd);
  }
  const int quarter = (int)(k - 4.0 * floor(0.25 * k));
  *s = quarter == 0 ? sines : quarter == 1 ? cosines : quarter == 2 ? N(negative)(sines) : N(negative)(cosines);
  *c = quarter == 0 ? cosines : quarter == 1 ? N(negative)(sines) : quarter == 2 ? N(negative)(cosines) : sines;
}

/* sqrt a by Newton's iteration from the leading part's root. */
static NUMBER N(root)(NUMBER a) {
  const double first = sqrt(a.part[0]);
  NUMBER y = N(of)(first);
  for (int i = 0; i < C && first > 0.0; i++)
    y = N(plus)(y, N(times)(N(minus)(a, N(times)(y, y)), N(over)(N(of)(0.5), y)));
  return y;
}

/* e^r - 1 by its series, |r| < 0.6. */
static NUMBER N(exponential_less_one)(NUMBER r) {
  NUMBER sum = r, term = r;
  for (int i = 2; i < 48 && fabs(term.part[0]) > 1e-54 * fabs(r.part[0]); i++) {
    term = N(over)(N(times)(term, r), N(of)(i));
    sum = N(plus)(sum, term);
  }
  return sum;
}

/* e^a = 2^k e^r, r = a - k log 2. */
static NUMBER N(exponential)(NUMBER a) {
  const double k = rint(a.part[0] * 1.4426950408889634);
  if (!(fabs(k) < 1000.0)) return N(of)(exp(a.part[0]));
  NUMBER y = N(plus)(N(exponential_less_one)(N(reduced)(a, k, TL_LOG_2)), N(of)(1.0));
  for (int i = 0; i < C; i++) y.part[i] = ldexp(y.part[i], (int)k);
  return y;
}

/* tanh a = E / (E + 2), E = e^(2a) - 1. */
static NUMBER N(hyperbolic)(NUMBER a) {
  const NUMBER twice = N(plus)(a, a);
  if (!(fabs(twice.part[0]) < 120.0)) return N(of)(tanh(a.part[0]));
  const NUMBER e = fabs(twice.part[0]) < 0.5 ? N(exponential_less_one)(twice) : N(minus)(N(exponential)(twice), N(of)(1.0));
  return N(over)(e, N(plus)(e, N(of)(2.0)));
}

/* The angle of (x, y) by Newton's iteration: that of (x, y) turned back by the angle so far. */
static NUMBER N(angle)(NUMBER y, NUMBER x) {
  NUMBER angle = N(of)(atan2(y.part[0], x.part[0])), s, c;
  if (x.part[0] == 0.0 && y.part[0] == 0.0) return angle;
  for (int i = 1; i < C + 1; i++) {
    N(sine)(angle, &s, &c);
    const NUMBER across = N(minus)(N(times)(y, c), N(times)(x, s)), along = N(plus)(N(times)(x, c), N(times)(y, s));
    angle = N(plus)(angle, N(over)(across, along));
  }
  return angle;
}

/* a^k = e^(k log a), the logarithm by Newton's iteration; libm's where it is 0, infinite or NaN. */
static NUMBER N(power)(NUMBER a, double k) {
  const double first = pow(a.part[0], k);
  if (!(a.part[0] > 0.0) || !(fabs(first) > 0.0) || !(fabs(first) <= 1e300)) return N(of)(first);
  NUMBER log_a = N(of)(log(a.part[0]));
  for (int i = 1; i < C + 1; i++)
    log_a = N(plus)(log_a, N(minus)(N(times)(a, N(exponential)(N(negative)(log_a))), N(of)(1.0)));
  return N(exponential)(N(times)(log_a, N(of)(k)));
}
#endif
