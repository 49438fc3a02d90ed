// SPDX-License-Identifier: Apache-2.0
// The OpenCR's sketch on a computer, in virtual time, upon what ROBOTIS's core does for it as far as its sources say.
//
// Orders come a line each on standard input: `hear HEX` (bytes on the motors' line, at its baud), `error` (of that line:
// the core restarts the receive buffer from its first place), `stop` (the receiver is not restarted), `full` (USB has no
// room for an answer), `usb HEX` (bytes on USB), `pass MS`. What happens is said on standard output: `feeds 0|1`, `line HEX`,
// `usb HEX`, `reset` (the watchdog has run out), and after each order `round US`, the longest round of the loop so far.
#include <Arduino.h>

#include "../opencr/imu_node/imu_node.ino"

#include <cstdio>
#include <cstring>
#include <deque>
#include <iostream>
#include <string>
#include <vector>

namespace {

constexpr uint32_t kRing = 1024;         // DRV_UART_RX_BUF_LENGTH
constexpr uint32_t kPatienceMs = 100;    // of Serial.write, for room

uint64_t clock_us = 0;
uint64_t refreshed_us = 0, slowest_us = 0;
uint32_t reload_ms = 0;
uint32_t line_baud = 0;

USART_TypeDef uart{};
DMA_Stream_TypeDef stream{};
uint8_t ring[kRing] = {};
uint32_t head = 0, tail = 0;

std::deque<uint8_t> from_usb;
bool usb_is_full = false;
uint8_t kept[16] = {};

void say(const char* what, const uint8_t* bytes, size_t size) {
    std::printf("%s ", what);
    for (size_t at = 0; at < size; ++at) std::printf("%02x", bytes[at]);
    std::printf("\n");
}

void turn_round() {
    const uint64_t began_us = clock_us;
    loop();
    ++clock_us;
    slowest_us = clock_us - began_us > slowest_us ? clock_us - began_us : slowest_us;
    if (clock_us - refreshed_us <= reload_ms * 1000ull) return;
    std::printf("reset\n");
    refreshed_us = clock_us;
}

void pass(uint64_t us) {
    for (const uint64_t until = clock_us + us; clock_us < until;) turn_round();
}

std::vector<uint8_t> bytes_of(const std::string& hex) {
    std::vector<uint8_t> bytes;
    for (size_t at = 0; at + 1 < hex.size(); at += 2)
        bytes.push_back(static_cast<uint8_t>(std::stoi(hex.substr(at, 2), nullptr, 16)));
    return bytes;
}

}  // namespace

USART_TypeDef* const USART3 = &uart;
DMA_Stream_TypeDef* const DMA1_Stream1 = &stream;
USBSerial Serial;
UARTClass Serial3;
SPIClass SPI_IMU;
EEPROMClass EEPROM;

void USBSerial::begin(uint32_t) {}
int USBSerial::available() { return static_cast<int>(from_usb.size()); }
int USBSerial::read() {
    const int byte = from_usb.front();
    from_usb.pop_front();
    return byte;
}
size_t USBSerial::write(const uint8_t* bytes, size_t size) {
    if (usb_is_full) clock_us += kPatienceMs * 1000;
    return static_cast<size_t>(CDC_Itf_Write(const_cast<uint8_t*>(bytes), static_cast<uint32_t>(size)));
}
extern "C" int32_t CDC_Itf_Write(uint8_t* bytes, uint32_t size) {
    if (usb_is_full) return 0;
    say("usb", bytes, size);
    return static_cast<int32_t>(size);
}

void UARTClass::begin(uint32_t baud) {
    line_baud = baud;
    uart.CR3 |= USART_CR3_DMAR;
    stream.CR |= DMA_SxCR_EN;
    tail = head;
}
int UARTClass::available() { return static_cast<int>((kRing + head - tail) % kRing); }
int UARTClass::read() {
    if (head == tail) return -1;
    const int byte = ring[tail];
    tail = (tail + 1) % kRing;
    return byte;
}
void UARTClass::flush() {}
void UARTClass::flushRx(uint32_t) { tail = head; }
size_t UARTClass::write(const uint8_t* bytes, size_t size) {
    say("line", bytes, size);
    clock_us += size * 10'000'000ull / line_baud;
    return size;
}

void SPIClass::begin() {}
void SPIClass::setDataMode(uint8_t) {}
void SPIClass::setBitOrder(uint8_t) {}
void SPIClass::setClockDivider(uint8_t) {}
uint8_t SPIClass::transfer(uint8_t) const { return 0xFF; }
uint8_t EEPROMClass::read(int place) { return kept[place]; }
void EEPROMClass::update(int place, uint8_t byte) { kept[place] = byte; }

uint32_t micros() { return static_cast<uint32_t>(clock_us++); }
void delay(uint32_t milliseconds) { clock_us += milliseconds * 1000ull; }
void pinMode(uint32_t, uint32_t) {}
void digitalWrite(uint32_t pin, uint32_t level) {
    if (pin == BDPIN_DXL_PWR_EN) std::printf("feeds %u\n", level);
}
void NVIC_SystemReset() {}
void drv_dxl_tx_enable(BOOL) {}
BOOL wdg_setup(uint32_t reload_time) {
    reload_ms = reload_time;
    return TRUE;
}
BOOL wdg_start() { return wdg_refresh(); }
BOOL wdg_refresh() {
    refreshed_us = clock_us;
    return TRUE;
}

int main() {
    setup();
    for (std::string what, rest; std::getline(std::cin, what);) {
        const size_t space = what.find(' ');
        rest = space == std::string::npos ? "" : what.substr(space + 1);
        what.resize(space == std::string::npos ? what.size() : space);
        if (what == "hear")
            for (const uint8_t byte : bytes_of(rest)) {
                pass(10'000'000 / line_baud);
                ring[head] = byte;
                head = (head + 1) % kRing;
            }
        else if (what == "error")
            head = 0;
        else if (what == "stop")
            uart.CR3 &= ~USART_CR3_DMAR;
        else if (what == "full")
            usb_is_full = true;
        else if (what == "usb")
            for (const uint8_t byte : bytes_of(rest)) from_usb.push_back(byte);
        else if (what == "pass")
            pass(std::stoull(rest) * 1000);
        std::printf("round %llu\n", static_cast<unsigned long long>(slowest_us));
    }
}
