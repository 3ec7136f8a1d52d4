/* FMI 3.0, Model Exchange and Co-Simulation, over the functions of a model, which data.h names. An instance is one
 * struct: nothing is global but constants. Memory is allocated for instances and for copies of their states alone. */
#include "data.h"
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifndef fmi3FunctionTypes_h /* of the official headers, which serve as well */
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)();
typedef void (*fmi3UnlockPreemptionCallback)();
#endif

#ifdef FMI3_FUNCTION_PREFIX /* of source code that is linked statically */
#define JOIN(a, b) a##b
#define NAMED(a, b) JOIN(a, b)
#define FMI(name) NAMED(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif
#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* The rows of z: t, pieces of tables, inputs, parameters, changes of both along a direction, states, their changes. */
enum { T, PIECE, U = PIECE + NT, P = U + NU, DU = P + NP, DP = DU + NU, X = DP + NP, DX = X + NX, NZ = DX + NX };
/* Value references: t, states, their rates, inputs, the energy, parameters, constants. */
enum { RATES = 1 + NX, INPUTS = RATES + NX, ENERGY = INPUTS + NU, PARAMETERS, CONSTANTS = PARAMETERS + NP };
enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENTS = 4, CONTINUOUS = 8, STEPS = 16, TERMINATED = 32 };

typedef struct {
  double z[NZ], tolerance, step, good, previous;
  int mode;
} State;

typedef struct {
  State now;
  double rates[NX], changes[2 * NX], k[STAGES][NX], x[NX], new[NX];
  bool fresh, steps; /* rates are those of now; whether this is Co-Simulation */
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
} Instance;

static fmi3Status fail(Instance *s, fmi3Status status, const char *text) {
  if (s->log)
    s->log(s->environment, status, "logStatusError", text);
  return status;
}

#define SELF(modes)                                                                                                    \
  Instance *s = instance;                                                                                              \
  if (!s)                                                                                                              \
    return fmi3Error;                                                                                                  \
  if (!(s->now.mode & (modes)))                                                                                        \
    return fail(s, fmi3Error, "a function is called in a mode in which it is not allowed")
#define REQUIRE(condition, text)                                                                                       \
  if (!(condition))                                                                                                    \
  return fail(s, fmi3Error, text)
enum { RUNNING = EVENTS | CONTINUOUS | STEPS, ANY = 63 };

static bool all_finite(const double *x, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; i++)
    sum += 0.0 * x[i];
  return sum == 0.0;
}

/* Put the pieces of tables that hold from t on into z; the time of the next knot. */
static double follow(double *z) {
  const double *knots = KNOTS + 1, *pieces = PIECES + 1, t = z[T] + 1e-13 * fmax(1.0, fabs(z[T]));
  double next = INFINITY, *to = z + PIECE;
  for (int i = 0; i < TABLES; i++) {
    const int n = SIZES[i][0], rows = SIZES[i][1];
    int below = 0;
    for (int above = n; below < above;) {
      const int middle = (below + above) / 2;
      *(knots[middle] <= t ? &below : &above) = middle + (knots[middle] <= t);
    }
    memcpy(to, pieces + below * rows, rows * sizeof *to);
    next = below < n ? fmin(next, knots[below]) : next;
    knots += n, pieces += (n + 1) * rows, to += rows;
  }
  return next;
}

/* ---------- the stepper: an explicit method with two error estimates, as DOP853, and the PI controller of Gustafsson (ACM TOMS 17, 1991, 533-554) ---------- */

/* One attempt over h from x: the new state, back on its manifold, and the square of its error over what is admitted. */
static double attempt(Instance *s, double t, double h, bool last) {
  double *z = s->now.z, high = 0.0, low = 0.0;
  for (int i = 0; i < STAGES; i++) {
    z[T] = t + C[i] * h;
    for (int n = 0; n < NX; n++) {
      double sum = 0.0;
      for (int j = 0; j < i; j++)
        sum += A[i][j] * s->k[j][n];
      z[X + n] = s->x[n] + h * sum;
    }
    MODEL(rate)(z, s->k[i]);
  }
  z[T] = t + h;
  for (int n = 0; n < NX; n++) {
    double sum = 0.0, e0 = 0.0, e1 = 0.0;
    for (int i = 0; i < STAGES; i++) {
      sum += B[i] * s->k[i][n];
      e0 += E[0][i] * s->k[i][n];
      e1 += E[1][i] * s->k[i][n];
    }
    const double after = s->x[n] + h * sum, squares = fmax(s->x[n] * s->x[n], after * after);
    /* Of velocities too it is absolute: an error of v becomes one of q, which grows with time. */
    const double admitted = s->now.tolerance * s->now.tolerance + squares * ROUNDING * ROUNDING;
    high += h * h * e0 * e0 / admitted / NX;
    low += h * h * e1 * e1 / admitted / NX;
    z[X + n] = after;
  }
  MODEL(projected)(z, s->new);
  if (last && !all_finite(s->new, NX)) /* near a singular position: the next step goes back */
    memcpy(s->new, z + X, sizeof s->new);
  return all_finite(s->new, NX) ? high * high / (high + 0.01 * low + 1e-300) : NAN;
}

/* Go on to the end, with the pieces of tables that hold now; false where no step leads on, after the last that did. */
static bool advance(Instance *s, double end) {
  State *now = &s->now;
  double t = now->z[T];
  s->fresh = false;
  while (t < end) {
    const double left = end - t;
    double h = left <= now->step * LAST_STEP ? left : left < 2.0 * now->step ? 0.5 * left : now->step;
    const double arrival = h == left ? end : t + h;
    h = arrival - t;
    memcpy(s->x, now->z + X, sizeof s->x);
    const double square = attempt(s, t, h, arrival == end);
    const bool admitted = square <= 1.0;
    if (square <= 1e300) {
      const double e = fmin(fmax(square, MIN_SQUARE), MAX_SQUARE);
      const double grown = fmin(pow(e, -0.35 / ERROR_ORDER) * pow(now->previous, 0.2 / ERROR_ORDER), MAX_FACTOR / SAFETY);
      const double factor = fmax(MIN_FACTOR, SAFETY * (admitted ? grown : pow(e, -0.5 / ERROR_ORDER)));
      now->step = admitted && h < now->step ? fmax(now->step, h * factor) : h * factor;
      if (admitted)
        now->good = now->step, now->previous = e;
    } else {
      now->step = now->good *= NO_NUMBER_FACTOR;
    }
    t = admitted ? arrival : t;
    now->z[T] = t;
    memcpy(now->z + X, admitted ? s->new : s->x, sizeof s->x);
    if (t < end && now->step <= 16.0 * ROUNDING * fmax(1.0, fabs(t))) {
      now->step = now->good = FIRST_STEP;
      return false;
    }
  }
  return true;
}

/* ---------- instances ---------- */

static void start(State *now) {
  memset(now, 0, sizeof *now);
  memcpy(now->z, START, sizeof now->z);
  now->mode = INSTANTIATED;
  now->step = now->good = FIRST_STEP;
  now->previous = FIRST_SQUARE;
  now->tolerance = TOLERANCE / MARGIN;
}

static Instance *instantiate(fmi3String token, bool steps, bool possible, fmi3InstanceEnvironment environment,
                             fmi3LogMessageCallback log) {
  const bool known = token && !strcmp(token, TOKEN);
  if (!known || !possible) {
    if (log)
      log(environment, fmi3Error, "logStatusError",
          known ? "this FMU has not what is asked for: no Model Exchange with closed loops, no event mode or "
                  "intermediate variables in Co-Simulation"
                : "the instantiation token is that of another FMU");
    return NULL;
  }
  Instance *s = calloc(1, sizeof *s);
  if (s) {
    start(&s->now);
    s->steps = steps, s->environment = environment, s->log = log;
  }
  return s;
}

EXPORT const char *FMI(GetVersion)(void) { return "3.0"; }

EXPORT fmi3Instance FMI(InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                  fmi3Boolean visible, fmi3Boolean logging,
                                                  fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
  return instantiate(token, false, !LOOPS, environment, log);
}

EXPORT fmi3Instance FMI(InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                                 fmi3Boolean early, const fmi3ValueReference references[], size_t n,
                                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                 fmi3IntermediateUpdateCallback update) {
  return instantiate(token, true, !events && !n, environment, log);
}

EXPORT fmi3Instance FMI(InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                                       fmi3Boolean visible, fmi3Boolean logging,
                                                       fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                       fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                                       fmi3UnlockPreemptionCallback unlock) {
  return NULL;
}

EXPORT void FMI(FreeInstance)(fmi3Instance instance) { free(instance); }

EXPORT fmi3Status FMI(SetDebugLogging)(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String names[]) {
  return instance ? fmi3OK : fmi3Error; /* errors alone are logged, always */
}

EXPORT fmi3Status FMI(Reset)(fmi3Instance instance) {
  SELF(ANY);
  start(&s->now);
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(EnterInitializationMode)(fmi3Instance instance, fmi3Boolean given, fmi3Float64 tolerance,
                                               fmi3Float64 from, fmi3Boolean stops, fmi3Float64 stop) {
  SELF(INSTANTIATED);
  REQUIRE(!given || tolerance > 0.0, "the tolerance must be above 0");
  if (given)
    s->now.tolerance = fmax(tolerance / MARGIN, ROUNDING);
  s->now.z[T] = from;
  follow(s->now.z);
  s->now.mode = INITIALIZATION;
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(ExitInitializationMode)(fmi3Instance instance) {
  SELF(INITIALIZATION);
  double *x = s->now.z + X, moved = 0.0;
  MODEL(projected)(s->now.z, s->new);
  memcpy(x, s->new, sizeof s->new);
  MODEL(projected)(s->now.z, s->new);
  for (int i = 0; i < NX; i++)
    moved = fmax(moved, fabs(s->new[i] - x[i]) / (1.0 + fabs(x[i])));
  REQUIRE(all_finite(s->new, NX) && moved <= 1e-9,
          "the initial state is not on its manifold: unit quaternions and closed loops are needed");
  s->now.mode = s->steps ? STEPS : EVENTS;
  s->fresh = false;
  return fmi3OK;
}

static fmi3Status change_mode(fmi3Instance instance, int from, int to) {
  SELF(from);
  s->now.mode = to;
  return fmi3OK;
}

EXPORT fmi3Status FMI(EnterEventMode)(fmi3Instance instance) { return change_mode(instance, CONTINUOUS, EVENTS); }
EXPORT fmi3Status FMI(EnterContinuousTimeMode)(fmi3Instance instance) {
  return change_mode(instance, EVENTS, CONTINUOUS);
}
EXPORT fmi3Status FMI(Terminate)(fmi3Instance instance) { return change_mode(instance, RUNNING, TERMINATED); }

/* ---------- variables ---------- */

/* The row of z that holds a state (shift 0) or its change along the direction (shift 1), and so on; -1: neither. */
static int row(fmi3ValueReference r, int shift) {
  if (r >= 1 && r < RATES)
    return X + (int)r - 1 + shift * NX;
  if (r >= INPUTS && r < ENERGY)
    return U + (int)r - INPUTS + shift * (NU + NP);
  if (r >= PARAMETERS && r < CONSTANTS)
    return P + (int)r - PARAMETERS + shift * (NU + NP);
  return -1;
}

static bool evaluate(Instance *s) {
  if (!s->fresh)
    MODEL(rate)(s->now.z, s->rates);
  return s->fresh = all_finite(s->rates, NX);
}

static const char singular[] = "the rates are no finite numbers: the state is singular";

EXPORT fmi3Status FMI(GetFloat64)(fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Float64 values[],
                                  size_t m) {
  SELF(ANY);
  REQUIRE(n == m, "expected one value a variable");
  for (size_t i = 0; i < n; i++) {
    if (r[i] == 0)
      values[i] = s->now.z[T];
    else if (row(r[i], 0) >= 0)
      values[i] = s->now.z[row(r[i], 0)];
    else if (r[i] >= RATES && r[i] < INPUTS) {
      if (!evaluate(s))
        return fail(s, fmi3Discard, singular);
      values[i] = s->rates[r[i] - RATES];
    } else if (r[i] == ENERGY)
      MODEL(energy)(s->now.z, values + i);
    else {
      REQUIRE(r[i] >= CONSTANTS && r[i] < CONSTANTS + NC, "there is no variable of this value reference");
      values[i] = FIXED[r[i] - CONSTANTS];
    }
  }
  return fmi3OK;
}

EXPORT fmi3Status FMI(SetFloat64)(fmi3Instance instance, const fmi3ValueReference r[], size_t n,
                                  const fmi3Float64 values[], size_t m) {
  SELF(ANY & ~TERMINATED);
  REQUIRE(n == m, "expected one value a variable");
  s->fresh = false;
  for (size_t i = 0; i < n; i++) {
    const bool state = r[i] >= 1 && r[i] < RATES, parameter = r[i] >= PARAMETERS && r[i] < CONSTANTS;
    const int modes = INSTANTIATED | INITIALIZATION | (state ? 0 : parameter ? EVENTS | STEPS : RUNNING);
    REQUIRE(row(r[i], 0) >= 0, "a variable that is computed, or constant, cannot be set");
    REQUIRE(s->now.mode & modes, "a variable cannot be set in this mode");
    REQUIRE(all_finite(values + i, 1), "a value is no finite number");
    s->now.z[row(r[i], 0)] = values[i];
  }
  return fmi3OK;
}

EXPORT fmi3Status FMI(GetDirectionalDerivative)(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n,
                                                const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[],
                                                size_t seeds, fmi3Float64 sensitivity[], size_t sensitivities) {
  SELF(INITIALIZATION | RUNNING);
  REQUIRE(m == seeds && n == sensitivities, "expected one number a variable");
  double *z = s->now.z, energy[2];
  memset(z + DU, 0, (X - DU) * sizeof *z);
  memset(z + DX, 0, NX * sizeof *z);
  for (size_t i = 0; i < m; i++) {
    REQUIRE(row(knowns[i], 1) >= 0, "derivatives are by states, inputs and parameters");
    z[row(knowns[i], 1)] = seed[i];
  }
  bool rates = false;
  for (size_t i = 0; i < n; i++) {
    if (unknowns[i] >= 1 && unknowns[i] < RATES) {
      sensitivity[i] = z[row(unknowns[i], 1)];
    } else if (unknowns[i] == ENERGY) {
      MODEL(energy_variation)(z, energy);
      sensitivity[i] = energy[1];
    } else {
      REQUIRE(unknowns[i] >= RATES && unknowns[i] < INPUTS, "derivatives are of states, their rates, and the energy");
      if (!rates)
        MODEL(variation)(z, s->changes);
      rates = true;
      sensitivity[i] = s->changes[NX + unknowns[i] - RATES];
    }
  }
  return all_finite(sensitivity, (int)n) ? fmi3OK : fail(s, fmi3Discard, singular);
}

/* ---------- Model Exchange ---------- */

EXPORT fmi3Status FMI(SetTime)(fmi3Instance instance, fmi3Float64 t) {
  SELF(EVENTS | CONTINUOUS);
  s->now.z[T] = t;
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(SetContinuousStates)(fmi3Instance instance, const fmi3Float64 x[], size_t n) {
  SELF(CONTINUOUS);
  REQUIRE(n == NX, "expected all states");
  memcpy(s->now.z + X, x, NX * sizeof *x);
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(GetContinuousStates)(fmi3Instance instance, fmi3Float64 x[], size_t n) {
  SELF(INITIALIZATION | EVENTS | CONTINUOUS);
  REQUIRE(n == NX, "expected all states");
  memcpy(x, s->now.z + X, NX * sizeof *x);
  return fmi3OK;
}

EXPORT fmi3Status FMI(GetContinuousStateDerivatives)(fmi3Instance instance, fmi3Float64 rates[], size_t n) {
  SELF(INITIALIZATION | EVENTS | CONTINUOUS);
  REQUIRE(n == NX, "expected all states");
  if (!evaluate(s))
    return fail(s, fmi3Discard, singular);
  memcpy(rates, s->rates, NX * sizeof *rates);
  return fmi3OK;
}

EXPORT fmi3Status FMI(GetNominalsOfContinuousStates)(fmi3Instance instance, fmi3Float64 nominals[], size_t n) {
  SELF(INITIALIZATION | EVENTS | CONTINUOUS);
  REQUIRE(n == NX, "expected all states");
  for (int i = 0; i < NX; i++)
    nominals[i] = 1.0;
  return fmi3OK;
}

EXPORT fmi3Status FMI(GetNumberOfContinuousStates)(fmi3Instance instance, size_t *n) {
  *n = NX;
  return instance ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status FMI(GetNumberOfEventIndicators)(fmi3Instance instance, size_t *n) {
  *n = 0;
  return instance ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status FMI(GetEventIndicators)(fmi3Instance instance, fmi3Float64 values[], size_t n) {
  SELF(INITIALIZATION | EVENTS | CONTINUOUS);
  REQUIRE(n == 0, "there are no event indicators");
  return fmi3OK;
}

EXPORT fmi3Status FMI(CompletedIntegratorStep)(fmi3Instance instance, fmi3Boolean final, fmi3Boolean *events,
                                               fmi3Boolean *terminate) {
  SELF(CONTINUOUS);
  *events = *terminate = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(UpdateDiscreteStates)(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                            fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *next,
                                            fmi3Float64 *time) {
  SELF(EVENTS);
  *again = *nominals = *values = false;
  *time = fmin(follow(s->now.z), END);
  *terminate = s->now.z[T] >= END * (1.0 - 1e-12); /* a table or a curve of the scene ends */
  *next = *time < INFINITY;
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(EvaluateDiscreteStates)(fmi3Instance instance) {
  SELF(INITIALIZATION | EVENTS);
  return fmi3OK;
}

/* ---------- Co-Simulation ---------- */

EXPORT fmi3Status FMI(DoStep)(fmi3Instance instance, fmi3Float64 from, fmi3Float64 size, fmi3Boolean final,
                              fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
  SELF(STEPS);
  const double t = s->now.z[T];
  *events = *terminate = *early = false;
  *reached = t;
  REQUIRE(size > 0.0 && size < INFINITY, "the step must be longer than 0");
  REQUIRE(fabs(from - t) <= 1e-9 * fmax(fabs(t), size), "the step does not begin where the last one ended");
  REQUIRE(from + size <= END * (1.0 + 1e-12), "a table or a curve of the scene ends before the step");
  bool done = true;
  while (done && s->now.z[T] < from + size)
    done = advance(s, fmin(follow(s->now.z), from + size));
  *reached = s->now.z[T];
  return done ? fmi3OK : fail(s, fmi3Discard, "no step of this tolerance leads on: the motion is singular there");
}

/* ---------- states of an instance ---------- */

EXPORT fmi3Status FMI(GetFMUState)(fmi3Instance instance, fmi3FMUState *state) {
  SELF(ANY);
  if (!*state)
    *state = malloc(sizeof(State));
  REQUIRE(*state, "no memory is left");
  memcpy(*state, &s->now, sizeof s->now);
  return fmi3OK;
}

EXPORT fmi3Status FMI(SetFMUState)(fmi3Instance instance, fmi3FMUState state) {
  SELF(ANY);
  REQUIRE(state, "there is no state");
  memcpy(&s->now, state, sizeof s->now);
  s->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status FMI(FreeFMUState)(fmi3Instance instance, fmi3FMUState *state) {
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi3OK;
}

EXPORT fmi3Status FMI(SerializedFMUStateSize)(fmi3Instance instance, fmi3FMUState state, size_t *size) {
  SELF(ANY);
  *size = sizeof s->now;
  return fmi3OK;
}

EXPORT fmi3Status FMI(SerializeFMUState)(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  SELF(ANY);
  REQUIRE(state && size == sizeof s->now, "the bytes are not as many as a state has");
  memcpy(bytes, state, size);
  return fmi3OK;
}

EXPORT fmi3Status FMI(DeserializeFMUState)(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                           fmi3FMUState *state) {
  SELF(ANY);
  REQUIRE(size == sizeof s->now, "the bytes are not as many as a state has");
  if (!*state)
    *state = malloc(size);
  REQUIRE(*state, "no memory is left");
  memcpy(*state, bytes, size);
  return fmi3OK;
}

/* ---------- what this FMU does not have ---------- */

static fmi3Status lacking(fmi3Instance instance, size_t n) {
  SELF(ANY);
  return n ? fail(s, fmi3Error, "a function is called for what this FMU does not have") : fmi3OK;
}

#define REFERENCES fmi3Instance instance, const fmi3ValueReference r[], size_t n
#define TYPE(name)                                                                                                     \
  EXPORT fmi3Status FMI(Get##name)(REFERENCES, fmi3##name values[], size_t m) { return lacking(instance, n); }         \
  EXPORT fmi3Status FMI(Set##name)(REFERENCES, const fmi3##name values[], size_t m) { return lacking(instance, n); }
#define LACKING(name, ...)                                                                                             \
  EXPORT fmi3Status FMI(name)(REFERENCES, __VA_ARGS__) { return lacking(instance, n); }
#define NOTHING(name, ...)                                                                                             \
  EXPORT fmi3Status FMI(name)(fmi3Instance instance, __VA_ARGS__) { return lacking(instance, 1); }

TYPE(Float32)
TYPE(Int8)
TYPE(UInt8)
TYPE(Int16)
TYPE(UInt16)
TYPE(Int32)
TYPE(UInt32)
TYPE(Int64)
TYPE(UInt64)
TYPE(Boolean)
TYPE(String)
LACKING(GetBinary, size_t sizes[], fmi3Binary values[], size_t m)
LACKING(SetBinary, const size_t sizes[], const fmi3Binary values[], size_t m)
LACKING(GetClock, fmi3Clock values[])
LACKING(SetClock, const fmi3Clock values[])
LACKING(GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
LACKING(GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
LACKING(GetShiftDecimal, fmi3Float64 shifts[])
LACKING(GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
LACKING(SetIntervalDecimal, const fmi3Float64 intervals[])
LACKING(SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
LACKING(SetShiftDecimal, const fmi3Float64 shifts[])
LACKING(SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
LACKING(GetOutputDerivatives, const fmi3Int32 orders[], fmi3Float64 values[], size_t m)
NOTHING(GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n)
NOTHING(GetVariableDependencies, fmi3ValueReference r, size_t of[], fmi3ValueReference on[], size_t elements[],
        fmi3DependencyKind kinds[], size_t n)
NOTHING(GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t n, const fmi3ValueReference knowns[],
        size_t m, const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[], size_t sensitivities)
NOTHING(ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
EXPORT fmi3Status FMI(EnterStepMode)(fmi3Instance instance) { return lacking(instance, 1); }
EXPORT fmi3Status FMI(EnterConfigurationMode)(fmi3Instance instance) { return lacking(instance, 1); }
EXPORT fmi3Status FMI(ExitConfigurationMode)(fmi3Instance instance) { return lacking(instance, 1); }
