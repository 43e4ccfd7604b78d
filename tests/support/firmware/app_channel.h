#ifndef APP_CHANNEL_H
#define APP_CHANNEL_H
#include <stddef.h>
#define APPCHANNEL_MTU 31
size_t appchannelReceiveDataPacket(void *buffer, size_t max_length, int timeout_ms);
#endif
