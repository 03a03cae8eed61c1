/* compile_only.c - every header twice before and twice after the implementation macro. Compiling it
 * is the test; checks.sh compile does so as C99, C11, C++11 and C++17 and in each order.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -c compile_only.c -o /dev/null */
#ifndef FIRST
#define FIRST "clothsim.h"
#endif
#ifndef SECOND
#define SECOND FIRST
#endif
#ifndef THIRD
#define THIRD FIRST
#endif

#ifndef CLOTHSIM_STATIC     /* a static function that is declared must be defined in its unit */
#include FIRST
#include SECOND
#include THIRD
#include FIRST
#endif

#define CLOTHSIM_IMPLEMENTATION
#include FIRST
#include SECOND
#include THIRD
#include FIRST

/* a user's unit goes on after the header, with the header's names usable */
int compile_only_version(void);
int compile_only_version(void) { return cloth_version(); }
