/* Six half-bridges: TIM1 and TIM8, three complementary pairs each, 40 kHz, centre-aligned, with dead time and
 * break inputs. */
#ifndef BRIDGES_H
#define BRIDGES_H

#include <stdbool.h>
#include <stdint.h>

#define BRIDGES_RATE_HZ 40000.0f /* 180 MHz / (2 x 2250) */

enum { BRIDGES = 6, BRIDGES_TOP = 2250 };

/* Outputs off. TIM8's fourth channel, once a period, is the trigger of the scan: its middle is the counter's end, as far
 * as can be from where the switches of a small drive work. */
void bridges_init(void);
void bridges_start(void);

/* All twelve switches open; at once. */
void bridges_off(void);

/* Closes the main output gates unless a break line is pulled. */
void bridges_on(void);

/* True when a break line was pulled since bridges_listen. */
bool bridges_broken(void);

/* Forgets earlier breaks, as far as no line is pulled now, and raises an interrupt at the next one. */
void bridges_listen(void);

/* No more interrupts of the break lines, which go on opening the gates. */
void bridges_deafen(void);

/* Duty cycles from 0 to BRIDGES_TOP, taken over together at the next update. */
void bridges_set(const uint16_t *duty);

#endif
