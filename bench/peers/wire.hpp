// What the comparison and an adapter's program say to each other over a pair of pipes. Same machine, same types:
// numbers go as they lie in memory.
#pragma once

#include "peers.hpp"

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include <unistd.h>

namespace peers {

enum class Command : std::uint8_t { model, result, seconds };

/// The other side is gone.
struct Disconnected : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Channel {
public:
  Channel(int in, int out) : in_(in), out_(out) {}

  template <class T>
    requires std::is_trivially_copyable_v<T>
  void put(const T& x)
  {
    write(&x, sizeof x);
  }
  template <class T>
    requires std::is_trivially_copyable_v<T>
  T get()
  {
    T x;
    read(&x, sizeof x);
    return x;
  }

  void put(const std::string& text)
  {
    put(text.size());
    write(text.data(), text.size());
  }
  std::string text()
  {
    std::string text(get<std::size_t>(), '\0');
    read(text.data(), text.size());
    return text;
  }

  void put(const MatrixXd& A)
  {
    put(A.rows());
    put(A.cols());
    write(A.data(), sizeof(double) * static_cast<std::size_t>(A.size()));
  }
  MatrixXd matrix()
  {
    const Index rows = get<Index>();
    MatrixXd A(rows, get<Index>());
    read(A.data(), sizeof(double) * static_cast<std::size_t>(A.size()));
    return A;
  }

  void put(const Model& model)
  {
    put(model.name);
    put(model.joints.size());
    for (const Joint& joint : model.joints) {
      put(joint.name);
      for (const int x : {joint.parent, static_cast<int>(joint.kind), joint.q, joint.v}) { put(x); }
      put(joint.mass);
      for (const MatrixXd& A :
           {MatrixXd(joint.R), MatrixXd(joint.p), MatrixXd(joint.axis), MatrixXd(joint.com), MatrixXd(joint.inertia)}) {
        put(A);
      }
    }
    put(model.motors.size());
    for (const int v : model.motors) { put(v); }
    put(model.contacts.size());
    for (const Contact& contact : model.contacts) {
      put(contact.name);
      put(contact.joint);
      put(MatrixXd(contact.p));
    }
    put(MatrixXd(model.gravity));
    put(model.n_q);
    put(model.n_v);
  }
  Model model()
  {
    Model model;
    model.name = text();
    model.joints.resize(get<std::size_t>());
    for (Joint& joint : model.joints) {
      joint.name = text();
      joint.parent = get<int>();
      joint.kind = static_cast<JointKind>(get<int>());
      joint.q = get<int>();
      joint.v = get<int>();
      joint.mass = get<double>();
      joint.R = matrix();
      joint.p = matrix();
      joint.axis = matrix();
      joint.com = matrix();
      joint.inertia = matrix();
    }
    model.motors.resize(get<std::size_t>());
    for (int& v : model.motors) { v = get<int>(); }
    model.contacts.resize(get<std::size_t>());
    for (Contact& contact : model.contacts) {
      contact.name = text();
      contact.joint = get<int>();
      contact.p = matrix();
    }
    model.gravity = matrix();
    model.n_q = get<int>();
    model.n_v = get<int>();
    return model;
  }

private:
  void write(const void* data, std::size_t size)
  {
    const char* p = static_cast<const char*>(data);
    while (size > 0) {
      const ssize_t n = ::write(out_, p, size);
      if (n < 0 && errno == EINTR) { continue; }
      if (n <= 0) { throw Disconnected("ended unexpectedly"); }
      p += n;
      size -= static_cast<std::size_t>(n);
    }
  }
  void read(void* data, std::size_t size)
  {
    char* p = static_cast<char*>(data);
    while (size > 0) {
      const ssize_t n = ::read(in_, p, size);
      if (n < 0 && errno == EINTR) { continue; }
      if (n <= 0) { throw Disconnected("ended unexpectedly"); }
      p += n;
      size -= static_cast<std::size_t>(n);
    }
  }

  int in_;
  int out_;
};

}  // namespace peers
