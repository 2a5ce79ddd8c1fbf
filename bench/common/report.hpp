// A report that goes to the terminal as plain text and to a file as Markdown.
#pragma once

#include "table.hpp"

#include <ostream>
#include <string>

namespace bench {

class Report {
public:
  Report(std::ostream& terminal, std::ostream& markdown) : terminal_(terminal), markdown_(markdown) {}

  void title(const std::string& text) { heading(text, "# ", '='); }
  void section(const std::string& text) { heading(text, "## ", '-'); }

  void paragraph(const std::string& text)
  {
    terminal_ << text << "\n\n";
    markdown_ << text << "\n\n";
  }

  void table(const Table& table)
  {
    table.print(terminal_);
    terminal_ << '\n';
    table.markdown(markdown_);
    markdown_ << '\n';
  }

  /// In Markdown only.
  void image(const std::string& file, const std::string& caption)
  {
    markdown_ << "![" << caption << "](" << file << ")\n\n";
  }

private:
  void heading(const std::string& text, const char* mark, char line)
  {
    terminal_ << '\n' << text << '\n' << std::string(width(text), line) << "\n\n";
    markdown_ << mark << text << "\n\n";
  }

  std::ostream& terminal_;
  std::ostream& markdown_;
};

}  // namespace bench
