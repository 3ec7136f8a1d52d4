/* Undoes lanes.h. */
#undef V
#undef N
#undef CAT
#undef CAT_
#undef SELECT
#undef IS_LESS
#undef IS_LESS_EQUAL
#undef LANE
#undef W
#undef LOG2_W
#undef SUFFIX
