// SPDX-License-Identifier: Apache-2.0
// The node: its register page, what is kept of it without power, and the samples of its chip.
//
// What the manual leaves open is assumed as Sinew's emulator has it: a gap between registers reads as 0, but a read that
// touches no register at all, or runs past the page, is an access error; a write that touches a gap is an access error;
// a write to several registers of which one is refused stores nothing.
#pragma once

#include "port.h"
#include "register_page.h"

#include <array>
#include <cstddef>
#include <cstdint>

namespace sinew {

constexpr uint8_t kFirmware = 1;

// As the chip has it: counts of its axes.
struct Sample {
    std::array<int16_t, 3> gyro;
    std::array<int16_t, 3> acceleration;
};

class Node {
public:
    Node(Clock& clock, Store& store);

    // Puts the registers to what they are after power-on.
    void start();

    uint8_t id() const { return bytes_[page::kId]; }
    uint32_t baud() const { return kBaudRates[bytes_[page::kBaudRate]]; }
    uint32_t return_delay_us() const { return kReturnDelayUs * bytes_[page::kReturnDelayTime]; }
    uint8_t status_return_level() const { return bytes_[page::kStatusReturnLevel]; }
    bool alert() const { return bytes_[page::kHardwareErrorStatus] != 0; }

    // Returns the bytes as they are at this moment, the clock among them; nullptr for what cannot be read.
    const uint8_t* read(uint16_t address, uint16_t size);
    Error write(uint16_t address, const uint8_t* data, size_t size);
    // Keeps a write until `act`.
    Error prepare(uint16_t address, const uint8_t* data, size_t size);
    Error act();
    // Puts the registers to what they are from the factory, but for id and baud where they are to be kept.
    void reset(bool keep_id, bool keep_baud);
    // Stores what is kept without power, if that has changed since: takes its time where the memory is flash.
    void settle();

    void describe_chip(uint8_t who_am_i, uint16_t filter_delay_us, uint16_t period_us);
    // Takes a sample that was found ready at a time. is_fresh: a look just before found none, so the chip made it then.
    // Between two fresh ones the chip made as many as there are periods; what was not taken of them is lost. One that
    // waited while the board was busy is late, and not lost.
    void take(const Sample& sample, uint32_t time_us, bool is_fresh);
    // Says whether the chip works.
    void report_chip(bool works);

private:
    Error judge(uint16_t address, const uint8_t* data, size_t size) const;
    void store(uint16_t address, uint32_t count, uint8_t size);
    uint32_t count(uint16_t address, uint8_t size) const;
    void initialise(uint16_t from);

    Clock& clock_;
    Store& store_;
    std::array<uint8_t, page::kSize> bytes_{};
    bool is_kept_stale_ = false;
    std::array<uint8_t, page::kSize> prepared_{};
    uint16_t prepared_address_ = 0;
    size_t prepared_size_ = 0;
    // The last fresh sample, and how many were taken since.
    bool has_timed_ = false;
    uint32_t timed_us_ = 0, taken_since_ = 0;
};

}  // namespace sinew
