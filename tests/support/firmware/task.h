#ifndef TASK_H
#define TASK_H
#include "FreeRTOS.h"
extern int critical; /* how deep the tests are in critical sections */
#define taskENTER_CRITICAL() (++critical)
#define taskEXIT_CRITICAL() (--critical)
TickType_t xTaskGetTickCount(void);
void vTaskDelayUntil(TickType_t *wake, TickType_t period);
#endif
