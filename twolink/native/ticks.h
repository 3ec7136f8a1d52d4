/* Many ticks of a law in one call, with the steps between them. Between two ticks it does what
`integrate/core/columns.py` does between two stops, which is the statement in NumPy. */

enum { N(PER_TICK) = 8 }; /* attempts between two ticks, at most: longer ones are left to the caller */

/* The program of a law at a tick: of the states (rows, columns) into the records. */
static void N(ask_program)(const tl_traced_law *law, int64_t columns, int64_t tick, const double *now) {
  const tl_program *p = law->program;
  const int64_t given = p->inputs - 1 - law->kept;
  double *u = law->u + tick * law->torques * columns, *registers = law->registers;
  const double *z = law->z + tick * law->kept * columns;
  double *after = law->z + (tick + 1) * law->kept * columns;
  for (int64_t s = 0; s < columns; s += W) {
    const int width = columns - s < W ? (int)(columns - s) : W;
    for (int l = 0; l < W; l++) registers[l] = law->times[tick];
    for (int64_t i = 0; i < given + law->kept; i++) {
      const double *from = (i < given ? now + law->rows[i] * columns : z + (i - given) * columns) + s;
      for (int l = 0; l < W; l++) registers[(1 + i) * W + l] = from[l < width ? l : width - 1];
    }
    N(evaluate)(p, registers);
    for (int64_t i = 0; i < p->outputs; i++) {
      const double *value = registers + (int64_t)p->output_at[i] * W;
      double *to = (i < law->torques ? u + i * columns : after + (i - law->torques) * columns) + s;
      for (int l = 0; l < width; l++)
        if (i < law->torques + law->kept) to[l] = value[l];
        else *law->zeros += value[l];
    }
  }
}

/* The answers of a tick, within their bounds, into the numbers that hold from now on. */
static void N(hold)(const tl_traced_law *law, int64_t columns, int64_t tick, double *now) {
  const double *u = law->u + tick * law->torques * columns;
  for (int64_t i = 0; i < law->torques; i++)
    for (int64_t c = 0; c < columns; c++) {
      const double limit = law->limits[i], value = u[i * columns + c], at_least = value < -limit ? -limit : value;
      now[law->held[i] * columns + c] = at_least > limit ? limit : at_least;
    }
}

/* Ticks from states (count + 1, rows, columns), whose first is that at the first tick; how many attempts were made. Ends
behind the last tick's end, or earlier where steps are shorter than ticks are apart, or there is no place for more. */
int64_t N(tl_ticks)(tl_workspace *work, int64_t columns, int64_t count, double *states, const tl_disturbance *disturbance,
                    tl_traced_law *law) {
  const tl_method *m = work->method;
  const int64_t rows = m->size + TL_CONTROLS + m->parameters, size = rows * columns;
  int64_t made = 0;
  for (int64_t tick = 0; tick < law->ticks; tick++) {
    double *now = states + made * size, *step = now + (m->size + N(STEP)) * columns, *end = now + (m->size + N(END)) * columns;
    const double apart = law->times[tick + 1] - law->times[tick], first = step[0];
    if (count - made < N(PER_TICK) || !(first >= (1.0 - 1e-12) * apart)) break;
    if (!law->call) N(ask_program)(law, columns, tick, now);
    else if (law->call(tick, made)) break;
    N(hold)(law, columns, tick, now);
    law->at[tick] = made;
    law->done = tick + 1;
    for (int64_t c = 0; c < columns; c++) end[c] = law->times[tick + 1];
    const int64_t tried = N(tl_attempts)(work, columns, N(PER_TICK), N(PER_TICK), now, disturbance);
    made += tried;
    const double *time = states + made * size + (m->size + N(TIME)) * columns;
    int arrived = 1;
    for (int64_t c = 0; c < columns; c++) arrived &= time[c] >= law->times[tick + 1];
    if (!arrived) break;
    if (!m->adaptive) memcpy(states + made * size + (m->size + N(STEP)) * columns, step, (size_t)columns * sizeof(double));
  }
  return made;
}
