// An adapter's program as the comparison sees it.
#pragma once

#include "peers.hpp"
#include "wire.hpp"

#include <cstring>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

namespace peers {

/// A child process and the pipes to it.
class Process {
public:
  /// Starts `program` with `arguments` and, after them, the numbers of its two descriptors.
  Process(const std::filesystem::path& program, std::vector<std::string> arguments)
  {
    int to[2];
    int from[2];
    if (pipe(to) != 0 || pipe(from) != 0) { throw std::runtime_error("no pipe"); }
    for (const int fd : {to[1], from[0]}) { fcntl(fd, F_SETFD, FD_CLOEXEC); }
    arguments.insert(arguments.begin(), program.string());
    arguments.push_back(std::to_string(to[0]));
    arguments.push_back(std::to_string(from[1]));
    std::vector<char*> argv;
    for (std::string& argument : arguments) { argv.push_back(argument.data()); }
    argv.push_back(nullptr);
    child_ = fork();
    if (child_ == 0) {
      execv(program.c_str(), argv.data());
      _exit(127);
    }
    close(to[0]);
    close(from[1]);
    if (child_ < 0) { throw std::runtime_error("no process"); }
    in_ = from[0];
    out_ = to[1];
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process()
  {
    if (child_ > 0) { end(); }
  }

  /// Waits for the end of the process that has hung up, and says what it was.
  std::string end()
  {
    close(out_);
    close(in_);
    int status = 0;
    waitpid(child_, &status, 0);
    child_ = -1;
    return WIFSIGNALED(status) ? std::string("signal ") + strsignal(WTERMSIG(status))
                               : "exit status " + std::to_string(WEXITSTATUS(status));
  }

  Channel channel() const { return {in_, out_}; }

private:
  pid_t child_ = -1;
  int in_ = -1;
  int out_ = -1;
};

/// A library, in its process.
class Worker {
public:
  explicit Worker(std::filesystem::path program) : program_(std::move(program)) { start(); }

  const std::string& name() const { return name_; }
  const std::string& version() const { return version_; }

  /// Names of the paths; empty if the library has no such models. Throws std::runtime_error with the library's words.
  std::vector<std::string> take(const Model& model, const std::vector<State>& states)
  {
    return guarded([&](Channel channel) {
      channel.put(Command::model);
      channel.put(model);
      channel.put(states.size());
      for (const State& x : states) {
        channel.put(MatrixXd(x.q));
        channel.put(MatrixXd(x.qd));
      }
      const std::string failure = channel.text();
      std::vector<std::string> names(channel.get<std::size_t>());
      for (std::string& name : names) { name = channel.text(); }
      if (!failure.empty()) { throw std::runtime_error(failure); }
      return names;
    });
  }

  Result result(std::size_t path, std::size_t state)
  {
    return guarded([&](Channel channel) {
      channel.put(Command::result);
      channel.put(path);
      channel.put(state);
      Result result;
      result.qdd0 = channel.matrix();
      result.Bhat = channel.matrix();
      return result;
    });
  }

  double seconds(std::size_t path, std::size_t evaluations)
  {
    return guarded([&](Channel channel) {
      channel.put(Command::seconds);
      channel.put(path);
      channel.put(evaluations);
      return channel.get<double>();
    });
  }

private:
  void start()
  {
    process_ = std::make_unique<Process>(program_, std::vector<std::string>{});
    Channel channel = process_->channel();
    name_ = channel.text();
    version_ = channel.text();
  }

  /// A library that ends its process is started again for the next model.
  template <class F>
  std::invoke_result_t<F, Channel> guarded(F&& f)
  {
    try {
      return f(process_->channel());
    } catch (const Disconnected&) {
      const std::string how = process_->end();
      start();
      throw std::runtime_error("the library ended its process (" + how + ")");
    }
  }

  std::filesystem::path program_;
  std::unique_ptr<Process> process_;
  std::string name_;
  std::string version_;
};

}  // namespace peers
