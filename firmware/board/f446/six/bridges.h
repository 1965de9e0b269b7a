/* Six half-bridges: TIM1 and TIM8, three complementary pairs each, 40 kHz, centre-aligned, with dead time and
 * break inputs. */
#ifndef BRIDGES_H
#define BRIDGES_H

#include <stdbool.h>
#include <stdint.h>

#define BRIDGES_RATE_HZ 40000.0f /* 180 MHz / (2 x 2250) */

enum { BRIDGES = 6, BRIDGES_TOP = 2250 };

/* Outputs off. TIM8's update, once a period, is the trigger of the scan. */
void bridges_init(void);
void bridges_start(void);

/* All twelve switches open; at once. */
void bridges_off(void);

/* Closes the main output gates unless a break line is pulled. */
void bridges_on(void);

/* True when a break line was pulled; forgets it. */
bool bridges_broken(void);

/* Duty cycles from 0 to BRIDGES_TOP, taken over together at the next update. */
void bridges_set(const uint16_t *duty);

#endif
