// SPDX-License-Identifier: Apache-2.0
// What imu_node.ino uses of ROBOTIS's core for the OpenCR, in outline, and the core's macros that get in the way of C++.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>

#include "chip.h"

#define HIGH 0x1
#define LOW 0x0
#define OUTPUT 0x1
#define TRUE 1
#define FALSE 0
#define BOOL uint8_t
#define CHANGE 2
#define DEFAULT 1
#define PI 3.1415926535897932
enum BitOrder { LSBFIRST = 0, MSBFIRST = 1 };

#ifdef abs
#undef abs
#endif
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define constrain(value, low, high) (min(max(value, low), high))
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
typedef unsigned int word;
typedef bool boolean;

// Registers of the motors' UART and of the DMA that fills its receive buffer.
struct USART_TypeDef {
    volatile uint32_t CR3;
};
struct DMA_Stream_TypeDef {
    volatile uint32_t CR;
};
extern USART_TypeDef* const USART3;
extern DMA_Stream_TypeDef* const DMA1_Stream1;
#define USART_CR3_DMAR 0x40u
#define DMA_SxCR_EN 0x1u

class USBSerial {
public:
    void begin(uint32_t baud);
    int available();
    int read();
    size_t write(const uint8_t* bytes, size_t size);
};
class UARTClass {
public:
    void begin(uint32_t baud);
    int available();
    int read();
    void flush();
    void flushRx(uint32_t timeout_ms);
    size_t write(const uint8_t* bytes, size_t size);
};
extern USBSerial Serial;
extern UARTClass Serial3;

extern "C" {
uint32_t micros();
void delay(uint32_t milliseconds);
void pinMode(uint32_t pin, uint32_t mode);
void digitalWrite(uint32_t pin, uint32_t level);
void NVIC_SystemReset();
void drv_dxl_tx_enable(BOOL enable);
BOOL wdg_setup(uint32_t reload_time);
BOOL wdg_start();
BOOL wdg_refresh();
void setup();
void loop();
}
