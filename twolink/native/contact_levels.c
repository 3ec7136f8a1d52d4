/* Which code for the envelope of a matrix runs on which level of a processor, see machine.c. */
#include "contact_solver.h"

TL_DECLARE_ENVELOPE(base)
#if defined(X86_LEVELS)
TL_DECLARE_ENVELOPE(v3)
TL_DECLARE_ENVELOPE(v4)
#define CALL(name, level, ...) \
  (level == 2 ? name##_v4(__VA_ARGS__) : level == 1 ? name##_v3(__VA_ARGS__) : name##_base(__VA_ARGS__))
#else
#define CALL(name, level, ...) ((void)level, name##_base(__VA_ARGS__))
#endif

int tl_factor_envelope(int level, const tl_envelope *a) { return CALL(tl_factor_envelope, level, a); }

void tl_solve_envelope(int level, const tl_envelope *a, double *x) { CALL(tl_solve_envelope, level, a, x); }

void tl_envelope_times(int level, const tl_envelope *g, const double *p, double *out) {
  CALL(tl_envelope_times, level, g, p, out);
}
