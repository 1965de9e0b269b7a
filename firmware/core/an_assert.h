/* Invariants: checked on the host, where a broken one ends the program, and taken for granted on the board, where the
 * supervisor, the guard and the watchdog are what ends a program that went astray. */
#ifndef AN_ASSERT_H
#define AN_ASSERT_H

#if defined(AN_CHECKED)
#define AN_ASSERT(truth) ((truth) ? (void)0 : __builtin_trap())
#else
#define AN_ASSERT(truth) ((void)0)
#endif

#endif
