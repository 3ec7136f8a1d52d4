/* Numbers of C parts, with the arithmetic of `expansions.h`. Included by taylor.c with C and SUFFIX for each C. */
#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)
#define N(name) CAT(CAT(name, _), SUFFIX)
#define NUMBER N(number)

typedef struct {
  double part[C];
} NUMBER;

static inline NUMBER N(of)(double x) { return (NUMBER){{x}}; }

/* A number from a sum whose parts overlap. */
static inline NUMBER N(normal)(const double *sum) {
  NUMBER out;
  for (int i = 0; i < C; i++) out.part[i] = sum[i];
  for (int from = 0; from < C - 1; from++)
    for (int i = C - 2; i >= from; i--) tl_two_sum(out.part[i], out.part[i + 1], &out.part[i], &out.part[i + 1]);
  return out;
}

static inline NUMBER N(negative)(NUMBER a) {
  for (int i = 0; i < C; i++) a.part[i] = -a.part[i];
  return a;
}

static inline NUMBER N(plus)(NUMBER a, NUMBER b) {
  for (int i = 0; i < C; i++) tl_add(C, a.part, i, b.part[i]);
  return N(normal)(a.part);
}

static inline NUMBER N(minus)(NUMBER a, NUMBER b) { return N(plus)(a, N(negative)(b)); }

static inline NUMBER N(times)(NUMBER a, NUMBER b) {
  double sum[C] = {0};
  tl_add_product(C, sum, a.part, b.part);
  return N(normal)(sum);
}

/* a / b by long division: each quotient of leading parts, and then what remains. */
static inline NUMBER N(over)(NUMBER a, NUMBER b) {
#if C == 1
  return N(of)(a.part[0] / b.part[0]);
#else
  double sum[C] = {0};
  for (int i = 0; i <= C; i++) {
    const double quotient = a.part[0] / b.part[0];
    tl_add(C, sum, i < C ? i : C - 1, quotient);
    a = N(minus)(a, N(times)(N(of)(quotient), b));
  }
  return N(normal)(sum);
#endif
}

static inline NUMBER N(loaded)(const double *at, size_t stride) {
  NUMBER out;
  for (int i = 0; i < C; i++) out.part[i] = at[(size_t)i * stride];
  return out;
}

static inline void N(stored)(double *at, size_t stride, NUMBER a) {
  for (int i = 0; i < C; i++) at[(size_t)i * stride] = a.part[i];
}
