/* two_units_b.c - the unit that holds the implementation for two_units_a.c.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. two_units_a.c two_units_b.c -lm -o out/two_units */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"

#ifdef __cplusplus
extern "C"
#endif
int two_units_b(const char **text);

int two_units_b(const char **text) {
    *text = cloth_status_text(CLOTH_ERR_MEMORY);
    return cloth_version();
}
