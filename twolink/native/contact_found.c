/* Points that the caller finds: of shapes that have no formula here, at the poses of the last `tl_place`. What it says is
checked. */
#include "contact.h"
#include "contact_vectors.h"

static int is_sound(const tl_scene *s, const tl_found *found) {
  if (found->count < 0 || found->count > (1 << 24)) return 0;
  if (found->count && !(found->keys && found->pair && found->first && found->second && found->gap && found->normal &&
                        found->position))
    return 0;
  for (int64_t k = 0; k < found->count; k++)
    if (found->pair[k] < 0 || found->pair[k] >= s->pairs || found->first[k] < 0 || found->first[k] >= s->bodies ||
        found->second[k] < 0 || found->second[k] >= s->bodies)
      return 0;
  return 1;
}

/* The points with gaps below the reach, those of a pair one after the other. Where the caller fails, the scene knows. */
void tl_detect_others(tl_scene *s, double reach) {
  tl_found found = {0};
  if (!s->find) return;
  if (s->find(reach, 0, s->turned, s->origin, &found) || !is_sound(s, &found)) {
    s->buried = 1;
    return;
  }
  for (int64_t k = 0; k < found.count; k++) {
    tl_point point = {.key = found.keys[k], .pair = found.pair[k], .first = found.first[k], .second = found.second[k],
                      .dof = -1, .gap = found.gap[k]};
    tl_copy3(found.normal + 3 * k, point.normal);
    tl_copy3(found.position + 3 * k, point.position);
    tl_add_point(s, &point);
  }
}

/* The largest overlap that the caller finds, m. */
double tl_overlap_of_others(tl_scene *s) {
  tl_found found = {0};
  if (!s->find) return 0.0;
  if (s->find(0.0, 1, s->turned, s->origin, &found)) s->buried = 1;
  return found.overlap;
}
