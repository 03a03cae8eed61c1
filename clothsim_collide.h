/* clothsim_collide.h - what cloth may not pass through.                       version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * Collisions for clothsim.h: continuous detection, impact zones solved by a quadratic program,
 * a proximity potential and friction inside the implicit step. C99, libc and libm only.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim_collide.h"
 * everywhere else:       #include "clothsim_collide.h"         (it includes clothsim.h)
 *
 * CONTENTS
 *   the interface
 *     [2.1] CONTINUOUS DETECTION             [2.2] QUADRATIC PROGRAM
 *     [2.3] INTERSECTIONS                    [2.4] DISTANCE GRID
 *     [2.5] CONTACT
 *   the implementation, bottom-up
 *     [3.1] EXACT SIGNS                      [3.2] DISTANCES
 *     [4.1] CONTINUOUS DETECTION
 *     [5.1] HIERARCHY                        [5.2] TRIANGLES THAT INTERSECT
 *     [6.1] QUADRATIC PROGRAM
 *     [7.1] DISTANCE GRID                    [7.2] OBSTACLES THAT PENETRATE THEMSELVES
 *     [8.1] SCENE                            [8.2] PROXIMITY AND FRICTION
 *     [8.3] IMPACT ZONES                     [8.4] THE CONTACT IN THE STEP
 *     [8.5] QUERIES                          [9.1] CHANGES
 */

#ifndef CLOTHSIM_COLLIDE_H
#define CLOTHSIM_COLLIDE_H

#include "clothsim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* ===== [2.4] DISTANCE GRID =================================================================== */

/* ===== [2.5] CONTACT ========================================================================= */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_COLLIDE_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_COLLIDE_IMPLEMENTED)
#define CLOTHSIM_COLLIDE_IMPLEMENTED

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] EXACT SIGNS ===================================================================== */

/* ===== [3.2] DISTANCES ======================================================================= */

/* ===== [4.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [5.1] HIERARCHY ======================================================================= */

/* ===== [5.2] TRIANGLES THAT INTERSECT ======================================================== */

/* ===== [6.1] QUADRATIC PROGRAM =============================================================== */

/* ===== [7.1] DISTANCE GRID =================================================================== */

/* ===== [7.2] OBSTACLES THAT PENETRATE THEMSELVES ============================================= */

/* ===== [8.1] SCENE =========================================================================== */

/* ===== [8.2] PROXIMITY AND FRICTION ========================================================== */

/* ===== [8.3] IMPACT ZONES ==================================================================== */

/* ===== [8.4] THE CONTACT IN THE STEP ========================================================= */

/* ===== [8.5] QUERIES ========================================================================= */

/* ===== [9.1] CHANGES =========================================================================
 *
 * 0.1.0  first version. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
