/* One attempted step of W columns, and many attempts in one call: `steps/step_control.py` and `steps/step_formulas.py` are
the statement in NumPy, which these lines follow from top to bottom. */

/* sum_j w_j k_j of row i; weights of 0 leave no operation. */
static inline V N(weighted)(const tl_workspace *work, const double *weights, int stages, int i) {
  const V *k = (const V *)work->stages;
  const int moving = work->method->moving;
  V sum = {0};
  for (int j = 0; j < stages; j++)
    if (weights[j] != 0.0) sum += k[j * moving + i] * weights[j];
  return sum;
}

/* f(t, x) into `out` (moving), with x (size) in the registers of the rate. */
static void N(rate)(tl_workspace *work, V t, V *out) {
  const tl_method *m = work->method;
  V *registers = (V *)work->rate_registers;
  registers[0] = t;
  for (int i = 0; i < m->parameters; i++) registers[1 + m->size + i] = ((const V *)work->parameters)[i];
  N(evaluate)(m->rate, work->rate_registers);
  for (int i = 0; i < m->moving; i++) out[i] = registers[m->rate->output_at[i]];
}

/* x + h sum_j a_j k_j into the registers of the rate. */
static void N(stage_state)(tl_workspace *work, const double *weights, int stages, V h) {
  const tl_method *m = work->method;
  const V *x = (const V *)work->x;
  V *registers = (V *)work->rate_registers + 1;
  for (int i = 0; i < m->moving; i++) registers[i] = x[i] + N(weighted)(work, weights, stages, i) * h;
  for (int i = m->moving; i < m->size; i++) registers[i] = x[i];
}

static void N(explicit_step)(tl_workspace *work, V t, V h) {
  const tl_method *m = work->method;
  for (int j = 0; j < m->stages; j++) {
    N(stage_state)(work, m->a[j], j, h);
    N(rate)(work, t + h * m->c[j], (V *)work->stages + j * m->moving);
  }
}

/* The factors of 1 - h d J of each column, J = df/dx at x + f(t, x) h / 2; rows of a column exchanged for its largest pivot. */
static void N(factor)(tl_workspace *work, V t, V h, double d) {
  const tl_method *m = work->method;
  const int n = m->moving;
  V *registers = (V *)work->jacobian_registers, *stages = (V *)work->stages;
  const V *x = (const V *)work->x;
  registers[0] = t + h * 0.5;
  for (int i = 0; i < n; i++) registers[1 + i] = x[i] + stages[i] * (h * 0.5);
  for (int i = n; i < m->size; i++) registers[1 + i] = x[i];
  for (int i = 0; i < m->parameters; i++) registers[1 + m->size + i] = ((const V *)work->parameters)[i];
  N(evaluate)(m->jacobian, work->jacobian_registers);
  for (int l = 0; l < W; l++) {
    double *a = work->matrix + (size_t)l * (size_t)n * (size_t)n;
    int32_t *pivots = work->pivots + l * n;
    for (int i = 0; i < n; i++)
      for (int j = 0; j < n; j++) a[i * n + j] = i == j;
    for (int e = 0; e < m->entries; e++) {
      const V entry = registers[m->jacobian->output_at[e]];
      a[m->entry_at[2 * e] * n + m->entry_at[2 * e + 1]] -= LANE(h, l) * d * LANE(entry, l);
    }
    for (int k = 0; k < n; k++) {
      int pivot = k;
      for (int i = k + 1; i < n; i++)
        if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
      pivots[k] = pivot;
      if (pivot != k)
        for (int j = 0; j < n; j++) {
          const double other = a[k * n + j];
          a[k * n + j] = a[pivot * n + j], a[pivot * n + j] = other;
        }
      for (int i = k + 1; i < n; i++) {
        const double f = a[i * n + k] /= a[k * n + k];
        if (f != 0.0)
          for (int j = k + 1; j < n; j++) a[i * n + j] -= f * a[k * n + j];
      }
    }
  }
}

/* Solves with the factors, in place: right (moving). */
static void N(solve)(tl_workspace *work, V *right) {
  const int n = work->method->moving;
  for (int l = 0; l < W; l++) {
    const double *a = work->matrix + (size_t)l * (size_t)n * (size_t)n;
    const int32_t *pivots = work->pivots + l * n;
    double *r = work->right;
    for (int i = 0; i < n; i++) r[i] = LANE(right[i], l);
    for (int k = 0; k < n; k++) {
      const double first = r[pivots[k]];
      r[pivots[k]] = r[k], r[k] = first;
    }
    for (int k = 0; k < n; k++)
      for (int i = k + 1; i < n; i++) r[i] -= a[i * n + k] * r[k];
    for (int k = n - 1; k >= 0; k--) {
      for (int j = k + 1; j < n; j++) r[k] -= a[k * n + j] * r[j];
      r[k] /= a[k * n + k];
    }
    for (int i = 0; i < n; i++) LANE(right[i], l) = r[i];
  }
}

/* Stages k_i = f(t + c_i h, x + h sum_{j<i} a_ij k_j + h d k_i), one after the other, by simplified Newton (Hairer, Wanner,
II, IV.8). The first rate is at (t, x), for the guess and for the place of the Jacobian. */
static void N(implicit_step)(tl_workspace *work, V t, V h) {
  const tl_method *m = work->method;
  const int n = m->moving;
  V *stages = (V *)work->stages, *change = (V *)work->change, *guess = stages + m->stages * n, *right = guess + n;
  const double none[TL_MAX_STAGES] = {0};
  double factored = 0.0;
  N(stage_state)(work, none, 0, h);
  N(rate)(work, t, stages);
  for (int i = 0; i < n; i++) guess[i] = stages[i], change[i] = (V){0};
  for (int j = 0; j < m->stages; j++) {
    const double d = m->a[j][j];
    const V at = t + h * m->c[j];
    if (d == 0.0) {
      if (j > 0) {
        N(stage_state)(work, m->a[j], j, h);
        N(rate)(work, at, guess);
      }
    } else {
      if (d != factored) {
        N(factor)(work, t, h, d);
        factored = d;
      }
      double weights[TL_MAX_STAGES];
      for (int i = 0; i < m->stages; i++) weights[i] = i < j ? m->a[j][i] : 0.0;
      for (int iteration = 0; iteration < m->iterations; iteration++) {
        N(stage_state)(work, weights, j, h);
        V *at_stage = (V *)work->rate_registers + 1;
        for (int i = 0; i < n; i++) at_stage[i] += guess[i] * (h * d);
        N(rate)(work, at, right);
        for (int i = 0; i < n; i++) right[i] -= guess[i];
        N(solve)(work, right);
        for (int i = 0; i < n; i++) guess[i] += right[i];
      }
      for (int i = 0; i < n; i++) change[i] += right[i] * (h * d);
    }
    for (int i = 0; i < n; i++) stages[j * n + i] = guess[i];
  }
}

/* The new state into `next` (size). */
static void N(step)(tl_workspace *work, V t, V h) {
  const tl_method *m = work->method;
  const V *x = (const V *)work->x;
  V *next = (V *)work->next;
  for (int i = m->moving; i < m->size; i++) next[i] = x[i];
  if (m->kind == TL_WHOLE) {
    V *registers = (V *)work->rate_registers;
    for (int i = 0; i < m->size; i++) registers[1 + i] = x[i];
    registers[1 + m->size + m->parameters] = h;
    N(rate)(work, t, next);
    return;
  }
  if (m->kind == TL_EXPLICIT) N(explicit_step)(work, t, h);
  else N(implicit_step)(work, t, h);
  for (int i = 0; i < m->moving; i++) next[i] = x[i] + N(weighted)(work, m->b, m->stages, i) * h;
}

static inline V N(larger_square)(V a, V b) {
  const V aa = a * a, bb = b * b;
  return SELECT(IS_LESS(aa, bb), bb, aa);
}

static const double N(ROUNDING) = 16 * 2.3e-16;

/* 1 / admitted^2 of each moving row, by the tolerance alone. */
static void N(by_tolerance)(tl_workspace *work, V tolerance) {
  const tl_method *m = work->method;
  const V *x = (const V *)work->x, *next = (const V *)work->next;
  const double rounding = N(ROUNDING) * N(ROUNDING);
  for (int i = 0; i < m->moving; i++) {
    const V largest = N(larger_square)(x[i], next[i]);
    ((V *)work->admitted)[i] = 1.0 / ((largest * (m->absolute[i] ? 0.0 : 1.0) + 1.0) * (tolerance * tolerance) + largest * rounding);
  }
}

/* More of it by the resolution: a part of what the step changes in the joint. */
static void N(by_resolution)(tl_workspace *work, V h, V resolution) {
  const tl_method *m = work->method;
  const V *x = (const V *)work->x, *next = (const V *)work->next;
  V *admitted = (V *)work->admitted;
  const V rounding = (1.0 + resolution) * (N(ROUNDING) * N(ROUNDING)), h2 = h * h;
  for (int j = 0; j < m->joints; j++) {
    const int32_t *rows = m->joint_rows + 4 * j;
    V q = {0}, v = {0};
    for (int i = rows[0]; i < rows[1]; i++) q += (next[i] - x[i]) * (next[i] - x[i]);
    for (int i = rows[2]; i < rows[3]; i++) v += (next[i] - x[i]) * (next[i] - x[i]);
    const V size = q + v * h2;
    for (int i = rows[0]; i < rows[1]; i++)
      admitted[i] += resolution / ((N(larger_square)(x[i], next[i]) + 1.0) * rounding + size);
    for (int i = rows[2]; i < rows[3]; i++)
      admitted[i] += resolution * h2 / ((N(larger_square)(x[i], next[i]) + 1.0) * rounding * h2 + size + 1e-300);
  }
}

/* The mean of change^2 / admitted^2 of an implicit step. */
static V N(unsolved)(const tl_workspace *work) {
  const tl_method *m = work->method;
  const V *change = (const V *)work->change, *admitted = (const V *)work->admitted;
  V sum = {0};
  for (int i = 0; i < m->moving; i++) sum += change[i] * change[i] * admitted[i];
  return sum * (1.0 / m->size);
}

/* e^2 over what is admitted: of one estimate, or of two of orders 5 and 3. */
static V N(error)(const tl_workspace *work, V h) {
  const tl_method *m = work->method;
  const V *admitted = (const V *)work->admitted;
  const V zero = {0};
  V squares[TL_MAX_ERRORS] = {zero, zero};
  for (int e = 0; e < m->errors; e++) {
    for (int i = 0; i < m->moving; i++) {
      const V error = N(weighted)(work, m->e[e], m->stages, i) * h;
      squares[e] += error * error * admitted[i];
    }
    squares[e] *= 1.0 / m->size;
  }
  V square = squares[0];
  if (m->errors == 2) square = square * square / (square + 0.01 * squares[1] + 1e-300);
  if (m->kind == TL_IMPLICIT) square += N(unsolved)(work);
  return square;
}

/* `next` back on its manifold into `change`, which is free by now; the sum of its squares. */
static V N(projected)(tl_workspace *work) {
  const tl_method *m = work->method;
  const V *next = (const V *)work->next;
  V *out = (V *)work->change, sum = {0};
  if (m->projection) {
    V *registers = (V *)work->projection_registers;
    for (int i = 0; i < m->size; i++) registers[i] = next[i];
    for (int i = 0; i < m->parameters; i++) registers[m->size + i] = ((const V *)work->parameters)[i];
    N(evaluate)(m->projection, work->projection_registers);
    for (int i = 0; i < m->moving; i++) out[i] = registers[m->projection->output_at[i]];
  } else
    for (int i = 0; i < m->moving; i++) out[i] = next[i];
  for (int i = 0; i < m->moving; i++) sum += out[i] * out[i];
  for (int i = m->moving; i < m->size; i++) sum += next[i] * next[i];
  return sum;
}

/* The next step's size of one column, from e^2. */
static double N(factor_of_step)(const tl_method *m, double square, double previous, int admitted) {
  const double power = 1.0 / m->order;
  const double rejected = 0.9 * pow(square, -0.5 * power);
  const double accepted = 0.9 * pow(square, -0.35 * power) * pow(previous, 0.2 * power);
  const double factor = admitted ? (accepted < 6.0 ? accepted : 6.0) : rejected;
  return factor > 0.2 ? factor : 0.2;
}

enum { N(TIME), N(STEP), N(GOOD), N(PREVIOUS), N(ACCEPTED), N(REJECTED), N(END), N(TOLERANCE), N(LONGEST), N(RESOLUTION) };

/* `next` by the embedded formula, x + h sum_j (b_j - e_j) k_j, in the columns that go on by it. */
static void N(embed)(tl_workspace *work, V h, V embedded) {
  const tl_method *m = work->method;
  const V zero = {0};
  V *next = (V *)work->next;
  for (int i = 0; i < m->moving; i++)
    next[i] = SELECT(IS_LESS(zero, embedded), next[i] - N(weighted)(work, m->e[0], m->stages, i) * h, next[i]);
}

/* One attempt of each column: its state and control afterwards in `x` and `control`. embedded: 1 in the columns that go on
by the embedded formula; or NULL. */
static void N(attempt)(tl_workspace *work, const V *embedded) {
  const tl_method *m = work->method;
  V *x = (V *)work->x, *control = (V *)work->control, *next = (V *)work->next, *projected = (V *)work->change;
  const V t = control[N(TIME)], end = control[N(END)], size = control[N(STEP)], left = end - t, zero = {0};
  V h = m->adaptive ? SELECT(IS_LESS(left, size * 2.0), left * 0.5, size) : size;
  const V arrival = SELECT(IS_LESS_EQUAL(left, size * (1.0 + 1e-6)), end, t + h);
  h = arrival - t;
  N(step)(work, t, h);
  if (embedded && m->errors) N(embed)(work, h, *embedded);
  if (!m->adaptive) {
    if (m->kind == TL_IMPLICIT) {
      N(by_tolerance)(work, zero + 1.0);
      const V unsolved = N(unsolved)(work);
      for (int i = 0; i < m->moving; i++) next[i] = SELECT(IS_LESS_EQUAL(unsolved, zero + 1e-9 * 1e-9), next[i], zero + NAN);
    }
    N(projected)(work);
    for (int i = 0; i < m->moving; i++) x[i] = SELECT(IS_LESS(zero, left), projected[i], x[i]);
    control[N(TIME)] = SELECT(IS_LESS(zero, left), arrival, t);
    control[N(ACCEPTED)] = SELECT(IS_LESS(zero, left), control[N(ACCEPTED)] + 1.0, control[N(ACCEPTED)]);
    return;
  }
  N(by_tolerance)(work, control[N(TOLERANCE)]);
  N(by_resolution)(work, h, control[N(RESOLUTION)]);
  V square = N(error)(work, h);
  const V sum = N(projected)(work);
  for (int l = 0; l < W; l++) {
    if (!(LANE(left, l) > 0.0)) continue;
    const int on_manifold = LANE(sum, l) <= 1e300;
    double e2 = LANE(square, l);
    if (!on_manifold && LANE(control[N(TOLERANCE)], l) < 1e300) e2 = NAN;
    const int admitted = e2 <= 1.0, finite = e2 <= 1e300;
    double bounded = e2 <= 1e30 ? e2 : 1e30;
    if (bounded < 1e-8) bounded = 1e-8;
    const double hl = LANE(h, l), good = admitted ? hl : LANE(control[N(GOOD)], l) * (finite ? 1.0 : 0.9);
    const double factor = N(factor_of_step)(m, bounded, LANE(control[N(PREVIOUS)], l), admitted);
    const double planned = LANE(size, l), longest = LANE(control[N(LONGEST)], l);
    double proposed = finite ? hl * factor : good;
    if (admitted && hl < planned * (1.0 - 1e-6) && proposed < planned) proposed = planned; /* a stop has cut the step */
    LANE(control[N(STEP)], l) = longest < proposed ? longest : proposed;
    LANE(control[N(GOOD)], l) = good;
    if (admitted) {
      const V *from = on_manifold ? projected : next;
      for (int i = 0; i < m->moving; i++) LANE(x[i], l) = LANE(from[i], l);
      LANE(control[N(TIME)], l) = LANE(arrival, l);
      LANE(control[N(PREVIOUS)], l) = bounded;
      LANE(control[N(ACCEPTED)], l) += 1.0;
    } else
      LANE(control[N(REJECTED)], l) += 1.0;
  }
}

/* sign r |x|, r random, and the bias times x, added to column `number`, which is lane l. */
static void N(disturb)(const tl_workspace *work, const tl_disturbance *d, int64_t number, int64_t columns, int l) {
  V *x = (V *)work->x;
  const V *control = (const V *)work->control;
  const int moving = work->method->moving;
  const int64_t attempts = (int64_t)(LANE(control[N(ACCEPTED)], l) + LANE(control[N(REJECTED)], l));
  const double *random = d->table + ((attempts + d->first[number]) % d->period) * moving;
  double least[2] = {0.0, 0.0};
  for (int part = 0; part < 2; part++)
    for (int i = d->parts[2 * part]; i < d->parts[2 * part + 1]; i++)
      if (fabs(LANE(x[i], l)) > least[part]) least[part] = fabs(LANE(x[i], l));
  for (int i = 0; i < moving; i++) {
    const int part = i >= d->parts[2] && i < d->parts[3] ? 1 : i >= d->parts[0] && i < d->parts[1] ? 0 : -1;
    const double own = fabs(LANE(x[i], l)), floor = part < 0 ? 0.0 : d->share * least[part], value = LANE(x[i], l);
    const double added = random[i] * (d->rounding[number] * (own > floor ? own : floor)) + d->bias[number] * value;
    LANE(x[i], l) = value + added * d->moves[i * columns + number];
  }
}

/* Up to `count` attempts of each column of states (count + 1, rows, columns), whose first is given; how many were made. Ends
when all have arrived, or, every `look` attempts, when half have. */
int64_t N(tl_attempts)(tl_workspace *work, int64_t columns, int64_t count, int64_t look, double *states,
                       const tl_disturbance *disturbance) {
  const tl_method *m = work->method;
  const int rows = m->size + TL_CONTROLS + m->parameters;
  const double *end_row;
  for (int64_t k = 0; k < count; k++) {
    const double *now = states + k * rows * columns;
    double *after = states + (k + 1) * rows * columns;
    int64_t going = 0;
    for (int64_t s = 0; s < columns; s += W) {
      const int width = columns - s < W ? (int)(columns - s) : W;
      for (int i = 0; i < rows; i++) {
        double *to = i < m->size ? work->x + i * W
                     : i < m->size + TL_CONTROLS ? work->control + (i - m->size) * W
                                                 : work->parameters + (i - m->size - TL_CONTROLS) * W;
        const double *from = now + i * columns + s;
        for (int l = 0; l < W; l++) to[l] = from[l < width ? l : width - 1];
      }
      V embedded = {0};
      int lower = 0;
      if (disturbance)
        for (int l = 0; l < width; l++) {
          lower |= (LANE(embedded, l) = disturbance->embedded[s + l]) > 0.0;
          if (work->control[N(TIME) * W + l] < work->control[N(END) * W + l] && disturbance->rounding[s + l] != 0.0)
            N(disturb)(work, disturbance, s + l, columns, l);
        }
      N(attempt)(work, lower ? &embedded : NULL);
      for (int i = 0; i < rows; i++) {
        const double *from = i < m->size ? work->x + i * W
                             : i < m->size + TL_CONTROLS ? work->control + (i - m->size) * W
                                                         : work->parameters + (i - m->size - TL_CONTROLS) * W;
        memcpy(after + i * columns + s, from, (size_t)width * sizeof(double));
      }
      end_row = after + (m->size + N(END)) * columns + s;
      for (int l = 0; l < width; l++) going += after[(m->size + N(TIME)) * columns + s + l] < end_row[l];
    }
    if (going == 0 || ((k + 1) % look == 0 && 2 * going < columns)) return k + 1;
  }
  return count;
}
