/* Invariants, checked on the host only, where a violation terminates the program. On the board the supervisor, the
 * guard and the watchdog stop a program that has gone wrong. */
#ifndef AN_ASSERT_H
#define AN_ASSERT_H

#if defined(AN_CHECKED)
#define AN_ASSERT(truth) ((truth) ? (void)0 : __builtin_trap())
#else
#define AN_ASSERT(truth) ((void)0)
#endif

#endif
