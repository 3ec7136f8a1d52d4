/* The machine for 1, 4, 8 and 16 columns; compiled once for each level of a processor: -DLEVEL=base, v3 or v4. */
#include "program.h"

#include <math.h>
#include <string.h>

#pragma STDC FP_CONTRACT ON

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

#define W 1
#define LOG2_W 0
#define SUFFIX JOIN(w1, LEVEL)
#include "lanes.h"
#include "evaluate.h"
#include "steps.h"
#include "ticks.h"
#include "lanes_end.h"

#define W 4
#define LOG2_W 2
#define SUFFIX JOIN(w4, LEVEL)
#include "lanes.h"
#include "evaluate.h"
#include "steps.h"
#include "ticks.h"
#include "lanes_end.h"

#define W 8
#define LOG2_W 3
#define SUFFIX JOIN(w8, LEVEL)
#include "lanes.h"
#include "evaluate.h"
#include "steps.h"
#include "ticks.h"
#include "lanes_end.h"

#define W 16
#define LOG2_W 4
#define SUFFIX JOIN(w16, LEVEL)
#include "lanes.h"
#include "evaluate.h"
#include "steps.h"
#include "ticks.h"
#include "lanes_end.h"
