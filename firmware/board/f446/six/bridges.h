/* Six half-bridges on TIM1 and TIM8: three complementary pairs each, centre-aligned PWM at 40 kHz, with dead time and
 * break inputs. */
#ifndef BRIDGES_H
#define BRIDGES_H

#include <stdbool.h>
#include <stdint.h>

#define BRIDGES_RATE_HZ 40000.0f /* 180 MHz / (2 x 2250) */

enum { BRIDGES = 6, BRIDGES_TOP = 2250 };

/* Prepare the timers with all outputs off. The fourth channel of TIM8 triggers the scan once per period, so that the
 * middle of the scan falls on the end of the count, as far as possible from the switching edges of a small drive. */
void bridges_init(void);
void bridges_start(void);

/* Open all twelve switches at once. */
void bridges_off(void);

/* Close the main output gates, unless a break line is asserted. */
void bridges_on(void);

/* True if a break line has been asserted since bridges_arm_break. */
bool bridges_broken(void);

/* Clear earlier breaks, unless a line is still asserted, and enable the interrupt for the next one. */
void bridges_arm_break(void);

/* Disable the interrupts of the break lines, which continue to open the gates. */
void bridges_mask_break(void);

/* Set the duty cycles, from 0 to BRIDGES_TOP, which take effect together at the next update. */
void bridges_set(const uint16_t *duty);

#endif
