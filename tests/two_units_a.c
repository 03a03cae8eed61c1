/* two_units_a.c - a host that only sees declarations; the implementation is in two_units_b.c.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. two_units_a.c two_units_b.c -lm -o out/two_units
 * Prints 'two units: ok'. checks.sh units also builds one of the two as C++. */
#include "clothsim.h"

#include <stdio.h>
#include <string.h>

#ifdef __cplusplus
extern "C"
#endif
int two_units_b(const char **text);

int main(void) {
    const char *text = NULL;
    if (two_units_b(&text) != cloth_version() || cloth_version() != CLOTH_VERSION_NUM) return 1;
    if (strcmp(text, cloth_status_text(CLOTH_ERR_MEMORY)) != 0) return 1;
    printf("two units: ok\n");
    return 0;
}
