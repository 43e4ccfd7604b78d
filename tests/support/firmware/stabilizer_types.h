/* Declarations of the Crazyflie firmware's interface, written for the tests from its documentation: names
 * and units of what a controller is given and gives back, no more. */
#ifndef STABILIZER_TYPES_H
#define STABILIZER_TYPES_H
#include <stdbool.h>
#include <stdint.h>

#define STABILIZER_NR_OF_MOTORS 4
typedef uint32_t stabilizerStep_t; /* of 1000 Hz */

typedef struct { float x, y, z; } Axis3f;
typedef struct { uint32_t timestamp; float x, y, z; } point_t, velocity_t, acc_t; /* m, m/s, g */
typedef struct { uint32_t timestamp; float roll, pitch, yaw; } attitude_t;        /* deg, deg/s */
typedef struct { uint32_t timestamp; float x, y, z, w; } quaternion_t;

typedef struct {
    attitude_t attitude;
    quaternion_t attitudeQuaternion;
    point_t position;
    velocity_t velocity;
    acc_t acc;
} state_t;

typedef struct { Axis3f acc, gyro, mag; } sensorData_t; /* g, deg/s, gauss */

typedef enum { modeDisable, modeAbs, modeVelocity } mode_t_;
typedef struct {
    attitude_t attitude, attitudeRate;
    float thrust;
    point_t position;
    velocity_t velocity;
    struct { mode_t_ x, y, z, roll, pitch, yaw, quat; } mode;
} setpoint_t;

typedef enum { controlModeLegacy, controlModeForceTorque, controlModeForce } control_mode_t;
typedef struct {
    union {
        struct { int16_t roll, pitch, yaw; float thrust; };
        struct { float thrustSi; float torque[3]; }; /* N, N m */
        float normalizedForces[STABILIZER_NR_OF_MOTORS];
    };
    control_mode_t controlMode;
} control_t;
#endif
