// What stands in a URDF file beside urdfdom's model: lines for messages, <transmission>, and what urdfdom says to
// stderr.
#pragma once

#if !__has_include(<urdf_parser/urdf_parser.h>)
#error "iim/urdf.hpp needs liburdfdom (in Debian and Ubuntu: liburdfdom-dev)"
#endif

#include <iim/errors.hpp>
#include <iim/subsystem/joint.hpp>

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>
// The XML library that urdfdom is made with: tinyxml until 3, tinyxml2 from 4.
#if !defined(TINYXML_INCLUDED) && !defined(TINYXML2_INCLUDED)
#include <tinyxml2.h>
#endif

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <exception>
#include <initializer_list>
#include <locale>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace iim::detail::urdf_file {

#ifdef TINYXML2_INCLUDED
using Document = tinyxml2::XMLDocument;
using Element = tinyxml2::XMLElement;
using Printer = tinyxml2::XMLPrinter;
inline int row(const Element& e) { return e.GetLineNum(); }
inline bool parse(Document& document, const std::string& text)
{
  return document.Parse(text.c_str(), text.size()) == tinyxml2::XML_SUCCESS;
}
inline std::pair<int, std::string> failure(const Document& document)
{
  return {document.ErrorLineNum(), document.ErrorStr()};
}
#else
using Document = TiXmlDocument;
using Element = TiXmlElement;
using Printer = TiXmlPrinter;
inline int row(const Element& e) { return e.Row(); }
inline bool parse(Document& document, const std::string& text)
{
  document.Parse(text.c_str());
  return !document.Error();
}
inline std::pair<int, std::string> failure(const Document& document)
{
  return {document.ErrorRow(), document.ErrorDesc()};
}
#endif

/// Calls f for the children of that name; of any name if it is null.
template <class F>
void for_each_child(const Element& parent, const char* name, F&& f)
{
  const auto* child = name != nullptr ? parent.FirstChildElement(name) : parent.FirstChildElement();
  while (child != nullptr) {
    f(*child);
    child = name != nullptr ? child->NextSiblingElement(name) : child->NextSiblingElement();
  }
}

inline std::string attribute(const Element& e, const char* name)
{
  const char* text = e.Attribute(name);
  return text != nullptr ? text : "";
}

/// What stands between its tags, comments left out.
inline std::string text_of(const Element& e)
{
  std::string text;
  for (const auto* child = e.FirstChild(); child != nullptr; child = child->NextSibling()) {
    if (child->ToText() != nullptr) { text += child->Value(); }
  }
  return text;
}

/// White space in attributes as XML and URDF mean it, tabs and line ends being blanks and those around numbers nothing:
/// urdfdom takes only single blanks for it, and goes on without a link's inertia where it finds others.
inline void straighten(Document& document)
{
  std::vector<Element*> elements{document.RootElement()};
  std::vector<std::pair<std::string, std::string>> others;
  while (!elements.empty()) {
    Element* const e = elements.back();
    elements.pop_back();
    others.clear();
    for (const auto* attribute = e->FirstAttribute(); attribute != nullptr; attribute = attribute->Next()) {
      const std::string name = attribute->Name(), before = attribute->Value();
      std::string value = before;
      std::replace_if(value.begin(), value.end(), [](char c) { return c == '\t' || c == '\n' || c == '\r'; }, ' ');
      if (name != "name" && name != "link" && name != "joint" && name != "type") {
        value.erase(value.find_last_not_of(' ') + 1);
        value.erase(0, value.find_first_not_of(' '));
      }
      if (value != before) { others.emplace_back(name, value); }
    }
    for (const auto& [name, value] : others) { e->SetAttribute(name.c_str(), value.c_str()); }
    for (Element* child = e->FirstChildElement(); child != nullptr; child = child->NextSiblingElement()) {
      elements.push_back(child);
    }
  }
}

inline std::string text_of(const Document& document)
{
  Printer printer;
  document.Accept(&printer);
  return printer.CStr();
}

inline std::string link_of(const Element& joint, const char* end)
{
  const Element* e = joint.FirstChildElement(end);
  return e != nullptr ? attribute(*e, "link") : "";
}

/// The file's name and where in it the links and joints are, for messages.
struct Source {
  std::string name;
  std::map<std::string, int> links{};
  std::map<std::string, int> joints{};
  std::set<std::string> with_inertia{};  ///< links

  std::string at(int row) const { return name + ":" + std::to_string(row) + ": "; }
  std::string link(const std::string& item) const { return at(links.at(item)) + "link '" + item + "'"; }
  std::string joint(const std::string& item) const { return at(joints.at(item)) + "joint '" + item + "'"; }
};

/// Collects what urdfdom says, and keeps it from stderr, while it lives. One at a time: console_bridge is global.
class Messages : public console_bridge::OutputHandler {
public:
  Messages() : lock_(mutex()), before_(console_bridge::getOutputHandler()), level_(console_bridge::getLogLevel())
  {
    console_bridge::useOutputHandler(this);
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_WARN);
  }
  ~Messages() override
  {
    console_bridge::setLogLevel(level_);
    console_bridge::useOutputHandler(before_);
  }
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;

  void log(const std::string& text, console_bridge::LogLevel, const char*, int) override { texts_.push_back(text); }
  const std::vector<std::string>& texts() const { return texts_; }

private:
  static std::mutex& mutex()
  {
    static std::mutex only;
    return only;
  }
  std::lock_guard<std::mutex> lock_;
  console_bridge::OutputHandler* before_;
  console_bridge::LogLevel level_;
  std::vector<std::string> texts_;
};

inline std::vector<double> numbers(const std::string& text, std::size_t count, const std::string& where)
{
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  std::vector<double> values;
  for (double x = 0; stream >> x;) { values.push_back(x); }
  if (!stream.eof() || values.size() != count) {
    throw ModelError(where + ": expected " + std::to_string(count) + (count == 1 ? " number" : " numbers") + ", got '" +
                     text + "'");
  }
  return values;
}

/// Throws unless every number of the link's <inertial> can be read: urdfdom goes on without an inertia then.
inline void check_inertial(const Element& link, const std::string& where)
{
  const Element* inertial = link.FirstChildElement("inertial");
  if (inertial == nullptr) { return; }
  const auto check = [&](const char* name, bool required, std::size_t count,
                         std::initializer_list<const char*> values) {
    const Element* e = inertial->FirstChildElement(name);
    if (e == nullptr && required) { throw ModelError(where + ": <inertial> without <" + name + ">"); }
    for (const char* value : values) {
      if (e == nullptr || (!required && e->Attribute(value) == nullptr)) { continue; }
      numbers(attribute(*e, value), count, where + ": <" + name + " " + value + ">");
    }
  };
  check("origin", false, 3, {"xyz", "rpy"});
  check("mass", true, 1, {"value"});
  check("inertia", true, 1, {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"});
}

/// Throws if one of these is given twice: urdfdom takes the first.
inline void check_once(const Element& e, const std::string& item, std::initializer_list<const char*> names)
{
  for (const char* name : names) {
    const Element* first = e.FirstChildElement(name);
    const Element* second = first != nullptr ? first->NextSiblingElement(name) : nullptr;
    if (second != nullptr) {
      throw ModelError(item + ": <" + name + "> is given twice, again in line " + std::to_string(row(*second)));
    }
  }
}

/// Throws if the turn of a joint or inertial is a quaternion, of URDF 1.2, which urdfdom goes on without in a file that
/// does not say that it is of this version, and refuses in one that does, if it does not know it.
inline void check_origin(const Element& parent, const std::string& version, const std::string& item)
{
  const Element* origin = parent.FirstChildElement("origin");
  if (origin != nullptr && origin->Attribute("quat_xyzw") != nullptr && version != "1.2") {
    throw ModelError(item + ": <origin quat_xyzw>, which a file without version='1.2' cannot have; give rpy");
  }
}

/// Joints and links by line. Throws for what urdfdom does not see, or reports without a line: unknown types, several
/// parents, loops.
inline Source survey(const Element& robot, const std::string& name)
{
  Source source{name};
  std::map<std::string, std::string> parent_of;
  std::map<std::string, std::string> joint_of;
  const std::string version = attribute(robot, "version");
  for_each_child(robot, nullptr, [&](const Element& e) {
    const std::string kind = e.Value();
    if (kind.starts_with("xacro:")) {
      throw ModelError(source.at(row(e)) + "<" + kind + ">: the file must be expanded by xacro first");
    }
    const std::string item = source.at(row(e)) + kind + " '" + attribute(e, "name") + "'";
    if (kind == "link") {
      const auto [before, is_new] = source.links.emplace(attribute(e, "name"), row(e));
      if (!is_new) {
        throw ModelError(item + ": there is a link of that name in line " + std::to_string(before->second));
      }
      check_once(e, item, {"inertial"});
      check_inertial(e, item);
      if (const Element* inertial = e.FirstChildElement("inertial")) {
        check_origin(*inertial, version, item);
        source.with_inertia.insert(attribute(e, "name"));
      }
    }
    if (kind != "joint") { return; }
    const std::string joint = attribute(e, "name");
    const auto [before, is_new] = source.joints.emplace(joint, row(e));
    if (!is_new) {
      throw ModelError(item + ": there is a joint of that name in line " + std::to_string(before->second));
    }
    check_once(e, item, {"origin", "parent", "child", "axis"});
    check_origin(e, version, item);
    const std::string type = attribute(e, "type");
    if (type == "planar") {
      throw ModelError(source.joint(joint) + ": planar joints are not supported; chain two prismatic and one revolute");
    }
    if (type != "revolute" && type != "continuous" && type != "prismatic" && type != "fixed" && type != "floating") {
      throw ModelError(source.joint(joint) + ": unknown type '" + type + "'");
    }
    const std::string child = link_of(e, "child");
    if (child.empty() || link_of(e, "parent").empty()) {
      throw ModelError(source.joint(joint) + ": <" + (child.empty() ? "child" : "parent") + " link> is missing");
    }
    if (!joint_of.emplace(child, joint).second) {
      throw ModelError(source.joint(joint) + ": link '" + child + "' has a parent already, by joint '" +
                       joint_of[child] + "'");
    }
    parent_of[child] = link_of(e, "parent");
  });
  std::set<std::string> rooted;  // known to be
  for (const auto& [link, joint] : joint_of) {
    for (const std::string& end : {link, parent_of[link]}) {
      if (!source.links.contains(end)) { throw ModelError(source.joint(joint) + ": there is no link '" + end + "'"); }
    }
    std::vector<std::string> path;
    std::string ancestor = link;
    for (; parent_of.contains(ancestor) && !rooted.contains(ancestor); ancestor = parent_of[ancestor]) {
      path.push_back(ancestor);
      if (path.size() > parent_of.size()) {
        throw ModelError(source.joint(joint) + ": link '" + link + "' hangs on a loop of joints");
      }
    }
    rooted.insert(path.begin(), path.end());
  }
  return source;
}

/// mechanicalReduction, mechanical_reduction, drake:gear_ratio, …: lower case without prefix and underscores.
inline std::string plain(std::string name)
{
  name.erase(0, name.find(':') + 1);
  std::erase(name, '_');
  for (char& c : name) { c = static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }
  return name;
}

/// What one <transmission> says of its joint's motor.
struct Transmission {
  double ratio = 1;
  double rotor_inertia = 0;                     ///< [kg m²]
  std::optional<Eigen::Vector3d> rotor_axis{};  ///< in joint axes
};

/// Whether a <transmission>, or a joint or actuator of it, says what its rotor weighs.
inline bool has_rotor(const Element& e)
{
  bool found = false;
  for_each_child(e, nullptr, [&](const Element& child) {
    const std::string name = plain(child.Value());
    found |= name == "rotorinertia" || name == "rotoraxis";
    if (name == "joint" || name == "actuator") { found |= has_rotor(child); }
  });
  return found;
}

/// Adds the motor of one <transmission> to those by joint. One that names no joint of the robot or several, as
/// differentials do, is left out with a warning: its joints are driven directly.
inline void read_transmission(const Element& e, const Source& source, std::map<std::string, Transmission>& motors,
                              std::vector<std::string>& warnings)
{
  const std::string where = source.at(row(e)) + "transmission '" + attribute(e, "name") + "'";
  std::vector<std::string> joints;
  for_each_child(e, "joint", [&](const Element& joint) { joints.push_back(attribute(joint, "name")); });
  if (joints.size() != 1) {
    const std::string names = where + ": names " + std::to_string(joints.size()) + " joints, ";
    if (has_rotor(e)) {
      throw ModelError(names + "but a rotor needs one (UrdfOptions::transmissions = false leaves all of them out)");
    }
    warnings.push_back(names + "left out");
    return;
  }
  if (!source.joints.contains(joints[0])) {  // as in files cut from that of a larger robot
    const std::string absent = where + ": there is no joint '" + joints[0] + "'";
    if (has_rotor(e)) { throw ModelError(absent); }
    warnings.push_back(absent + ", left out");
    return;
  }

  Transmission motor;
  std::map<std::string, std::vector<double>> given;
  const auto read = [&](const Element& parameter) {
    std::string name = plain(parameter.Value());
    if (name == "mechanicalreduction") { name = "gearratio"; }
    if (name != "gearratio" && name != "rotorinertia" && name != "rotoraxis") { return; }
    const char* const key = name == "rotoraxis" ? "xyz" : "value";
    const std::string item = where + ": <" + parameter.Value() + ">";
    const std::string between = text_of(parameter);
    const bool as_attribute = parameter.Attribute(key) != nullptr;
    if (as_attribute && between.find_first_not_of(" \t\r\n") != std::string::npos) {
      throw ModelError(item + " is given twice, '" + attribute(parameter, key) + "' and '" + between + "'");
    }
    const std::string value = as_attribute ? attribute(parameter, key) : between;
    const std::vector<double> x = numbers(value, name == "rotoraxis" ? 3 : 1, item);
    const auto [before, is_new] = given.emplace(name, x);
    if (!is_new && before->second != x) {
      std::ostringstream first;
      for (const double& number : before->second) { first << (&number == before->second.data() ? "" : " ") << number; }
      throw ModelError(item + " is given twice, '" + first.str() + "' and '" + value + "'");
    }
    if (name == "gearratio") {
      motor.ratio = x[0];
      if (x[0] == 0) { throw ModelError(item + " must not be zero, got " + value); }
    } else if (name == "rotorinertia") {
      motor.rotor_inertia = x[0];
      if (x[0] < 0) { throw ModelError(item + " must not be negative, got " + value + " kg m²"); }
    } else {
      motor.rotor_axis = UnitAxis<double>(Eigen::Vector3d(x[0], x[1], x[2]), item).direction;
    }
  };
  for_each_child(e, nullptr, read);
  for_each_child(e, "joint", [&](const Element& joint) { for_each_child(joint, nullptr, read); });
  for_each_child(e, "actuator", [&](const Element& actuator) { for_each_child(actuator, nullptr, read); });
  if (!motors.emplace(joints[0], motor).second) {
    throw ModelError(where + ": joint '" + joints[0] + "' has one already");
  }
}

/// All of them, those of ros2_control among them.
inline std::map<std::string, Transmission> read_transmissions(const Element& robot, const Source& source,
                                                              std::vector<std::string>& warnings)
{
  std::map<std::string, Transmission> motors;
  const auto read = [&](const Element& e) { read_transmission(e, source, motors, warnings); };
  for_each_child(robot, "transmission", read);
  for_each_child(robot, "ros2_control", [&](const Element& control) { for_each_child(control, "transmission", read); });
  return motors;
}

/// Line and item that urdfdom speaks of, as in «Malformed parent origin element for joint [elbow]»; else the robot's.
inline std::string item_of(const std::string& said, const Element& robot, const Source& source)
{
  for (std::size_t open = said.find('['); open != std::string::npos; open = said.find('[', open + 1)) {
    const std::size_t close = said.find(']', open);
    if (close == std::string::npos) { break; }
    const std::string item = said.substr(open + 1, close - open - 1);
    const bool is_link = said.substr(0, open).ends_with("link ");
    if (source.joints.contains(item) && !is_link) { return source.joint(item); }
    if (source.links.contains(item)) { return source.link(item); }
  }
  return source.at(row(robot)) + "robot '" + attribute(robot, "name") + "'";
}

/// urdfdom's model of a text, whose root element is `robot`. Throws ModelError with what urdfdom says if there is none;
/// else leaves it in `warnings`.
inline urdf::ModelInterfaceSharedPtr read_model(const std::string& text, const Element& robot, const Source& source,
                                                std::vector<std::string>& warnings)
{
  urdf::ModelInterfaceSharedPtr model;
  std::string reasons;
  const Messages messages;
  try {
    model = urdf::parseURDF(text);
  } catch (const std::exception& e) {
    reasons = std::string(": ") + e.what();
  }
  for (const std::string& message : messages.texts()) { reasons += ": " + message; }
  if (!model) { throw ModelError(item_of(reasons, robot, source) + reasons); }
  warnings.insert(warnings.end(), messages.texts().begin(), messages.texts().end());
  return model;
}

}  // namespace iim::detail::urdf_file
